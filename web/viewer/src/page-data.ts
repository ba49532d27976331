/** The data that a bake puts into the page (format/FORMAT.md, "The page data"). */

import type { Vec3 } from "lightwell";

/** A pinhole camera. */
export interface CameraData {
  readonly position: Vec3;
  readonly target: Vec3;
  readonly up: Vec3;
  /** Vertical field of view, degrees. */
  readonly fovY: number;
}

/** A camera and a light for which a path-traced picture may exist. */
export interface ViewData {
  readonly name: string;
  readonly camera: CameraData;
  /** Value of the first declared light. */
  readonly light: Vec3 | null;
  /** Values of the others, in their order. */
  readonly further: readonly Vec3[];
  /** Slider of the nodes that move, 0 to 1; null: as the file shows them. */
  readonly pose: readonly number[] | null;
  readonly width: number;
  readonly height: number;
  /** Radiance below which the steps of the reference are even. */
  readonly dark: number;
  /** base64 of the packed picture (format/FORMAT.md, "The page data"), first row at the top; empty when there is none. */
  readonly reference: string;
}

/** Everything about a page that is not the asset. */
export interface PageData {
  readonly title: string;
  /** Linear factor before tone mapping; null: chosen from the picture. */
  readonly exposure: number | null;
  readonly home: CameraData | null;
  readonly views: readonly ViewData[];
  /** What the bake measured: the numbers of its report by name; `seconds` is the whole bake. */
  readonly report: Readonly<Record<string, number>>;
  /** Pages beside this one. */
  readonly links: readonly PageLink[];
}

export interface PageLink {
  /** Path relative to the page. */
  readonly href: string;
  readonly text: string;
}

export const EMPTY_PAGE: PageData = { title: "", exposure: null, home: null, views: [], report: {}, links: [] };

const MAX_VIEWS = 64;
const MAX_SIDE = 4096;

/** Read page data; malformed parts are dropped, for the picture does not depend on them. */
export function readPageData(value: unknown): PageData {
  if (!isRecord(value)) return EMPTY_PAGE;
  const exposure = Number(value.exposure);
  return {
    title: typeof value.title === "string" ? value.title.slice(0, 120) : "",
    exposure: exposure > 0 && Number.isFinite(exposure) ? exposure : null,
    home: readCamera(value.home),
    views: Array.isArray(value.views) ? value.views.slice(0, MAX_VIEWS).flatMap(readView) : [],
    report: readReport(value.report),
    links: Array.isArray(value.links) ? value.links.flatMap(readLink) : [],
  };
}

function readLink(value: unknown): PageLink[] {
  if (!isRecord(value) || typeof value.href !== "string" || typeof value.text !== "string") return [];
  // Relative paths of pages only: a slash in front would lead elsewhere, two of them to another server.
  return /^(?!\/)[\w./-]+\.html$/.test(value.href) ? [{ href: value.href, text: value.text.slice(0, 40) }] : [];
}

function readView(value: unknown, index: number): ViewData[] {
  const camera = isRecord(value) ? readCamera(value.camera) : null;
  if (!isRecord(value) || !camera) return [];
  const [width, height] = [readSide(value.width), readSide(value.height)];
  const dark = Number(value.dark);
  const known = typeof value.reference === "string" && width && height && dark > 0 && Number.isFinite(dark);
  const reference = known ? (value.reference as string) : "";
  const name = typeof value.name === "string" && value.name ? value.name.slice(0, 40) : `View ${index + 1}`;
  return [{ name, camera, light: readVec3(value.light), further: readFurther(value.further), pose: readPose(value.pose), width: width || 4, height: height || 3, dark, reference }];
}

function readFurther(value: unknown): Vec3[] {
  return Array.isArray(value) ? value.slice(0, MAX_POSE).map(readVec3).filter((light) => light !== null) : [];
}

/** Most sliders of a pose. */
const MAX_POSE = 4;

function readPose(value: unknown): number[] | null {
  const isShare = (slider: unknown) => typeof slider === "number" && slider >= 0 && slider <= 1;
  return Array.isArray(value) && value.length <= MAX_POSE && value.every(isShare) ? value : null;
}

function readSide(value: unknown): number {
  return Number.isInteger(value) && (value as number) > 0 && (value as number) <= MAX_SIDE
    ? (value as number)
    : 0;
}

function readCamera(value: unknown): CameraData | null {
  if (!isRecord(value)) return null;
  const [position, target] = [readVec3(value.position), readVec3(value.target)];
  const fovY = Number(value.fov_y ?? 45);
  if (!position || !target || !(fovY > 1 && fovY < 170)) return null;
  return { position, target, up: readVec3(value.up) ?? [0, 1, 0], fovY };
}

function readVec3(value: unknown): Vec3 | null {
  if (!Array.isArray(value) || value.length !== 3 || !value.every((x) => Number.isFinite(x))) return null;
  return value as unknown as Vec3;
}

function readReport(value: unknown): Record<string, number> {
  if (!isRecord(value)) return {};
  const seconds = isRecord(value.seconds) ? value.seconds.total : value.seconds;
  const entries = Object.entries({ ...value, seconds }).filter(([, x]) => Number.isFinite(x));
  return Object.fromEntries(entries) as Record<string, number>;
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}
