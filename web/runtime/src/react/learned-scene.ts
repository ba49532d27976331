/** Learned light in @react-three/fiber. */

import { type ThreeElements, useFrame, useLoader, useThree } from "@react-three/fiber";
import { createElement, type ReactElement, type Ref, useEffect, useImperativeHandle, useMemo } from "react";
import { Vector3, type WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { LearnedScene as Learned, type LearnedSceneOptions } from "../learned-scene.ts";
import { LightwellLoaderPlugin } from "../loader.ts";
import { moverProps, setMovers } from "../mover-props.ts";
import type { Parts } from "../scene-core.ts";
import type { LampSetting } from "../switches.ts";
import { UnknownNames } from "../unknown-names.ts";

/** Options of `useLearnedScene`. */
export type UseLearnedSceneOptions = Pick<LearnedSceneOptions, "weights" | "environment">;

/**
 * Load a file and light it in the nearest `<Canvas>`: suspends while it loads, throws for the nearest error boundary when the file
 * cannot be shown, follows lamps and materials before every frame, and gives everything back with the component; React's StrictMode,
 * which mounts twice, lights it again. Put `scene.root` into a `<primitive>`. A file is loaded once for each address: two
 * components that are to show one file need two addresses, or a root each.
 *
 * Args: the file's address; how its light is set up. Returns the scene with its lamps and fields.
 */
export function useLearnedScene(src: string, { weights, environment }: UseLearnedSceneOptions = {}): Learned {
  const renderer = useThree((state) => state.gl) as WebGLRenderer;
  const invalidate = useThree((state) => state.invalidate);
  const gltf = useLoader(GLTFLoader, src, (loader) => {
    loader.register((parser) => new LightwellLoaderPlugin(parser, { renderer }));
  });
  const scene = useMemo(
    () => new Learned(gltf, { renderer, ...(weights ? { weights } : {}), ...(environment ? { environment } : {}) }),
    [gltf, renderer, weights, environment],
  );
  useEffect(() => {
    scene.attach();
    invalidate();
    // The loader keeps the file for the next component that asks for it: its textures stay.
    return () => scene.dispose({ textures: false });
  }, [scene, invalidate]);
  useFrame(() => scene.update());
  return scene;
}

/** Properties of `<LearnedScene>`: those of a group, and these. */
export interface LearnedSceneProps extends Omit<ThreeElements["group"], "ref" | "children">, UseLearnedSceneOptions {
  /** Address of the file. */
  readonly src: string;
  /** Place of the first lamp, metres; it stays inside the box in which its light was learned. */
  readonly light?: readonly [number, number, number];
  /** Time of day, `18:30` or hours, where a sun of the file knows one. */
  readonly day?: string | number;
  /** Degrees by which the environment map is turned, clockwise seen from above, where it may turn. */
  readonly environmentRotation?: number;
  /** Settings of the scene's own lamps by name, such as `{ desk: 0.3 }`; the others are as in the file. */
  readonly lamps?: Readonly<Record<string, LampSetting>>;
  /** Values of the nodes that move by name, degrees or metres, such as `{ Door: 45 }`; the others are as the file shows them first. */
  readonly movers?: Readonly<Record<string, number>>;
  /** Which parts of the light are shown; all of them unless given. */
  readonly parts?: Parts;
  /** The scene, for lamps, looks and all else. */
  readonly ref?: Ref<Learned>;
  /** `door={0.5}`: the short form of what moves, 0 to 1 of its range, by its name in lower case. It wins over `movers`. */
  readonly [mover: Lowercase<string>]: unknown;
}

/** Properties that are not of three.js' groups. */
const OWN = ["src", "light", "day", "environmentRotation", "lamps", "movers", "parts", "weights", "environment", "ref", "key", "children", "attach", "args", "dispose"];

/** Whether a group takes a property: one of its own or of a part (`position-x`), an event, or what belongs to @react-three/fiber and React. */
function isOfGroup(name: string, group: object): boolean {
  return OWN.includes(name) || name in group || name.split("-")[0]! in group || /^on[A-Z]/.test(name) || name.startsWith("__");
}

/** `<Canvas shadows><Suspense><LearnedScene src="scene.glb" /></Suspense></Canvas>`: a file with its learned light, wherever its group stands. */
export function LearnedScene({ src, light, day, environmentRotation, lamps, movers, parts, weights, environment, ref, ...group }: LearnedSceneProps): ReactElement {
  const scene = useLearnedScene(src, { ...(weights ? { weights } : {}), ...(environment ? { environment } : {}) });
  const invalidate = useThree((state) => state.invalidate);
  useImperativeHandle(ref, () => scene, [scene]);
  const [x, y, z] = light ?? [];
  useEffect(() => {
    if (x !== undefined) scene.lamps[0]?.move(new Vector3(x, y, z));
  }, [scene, x, y, z]);
  useEffect(() => {
    if (day !== undefined) scene.setDay(day);
  }, [scene, day]);
  useEffect(() => {
    if (environmentRotation !== undefined) scene.setEnvironmentRotation(environmentRotation);
  }, [scene, environmentRotation]);
  const settings = JSON.stringify(lamps ?? {});
  useEffect(() => {
    for (const lamp of scene.switches) lamp.reset();
    for (const [name, setting] of Object.entries(JSON.parse(settings) as Record<string, LampSetting>)) scene.setLamp(name, setting);
  }, [scene, settings]);
  const props = useMemo(() => moverProps(scene.movers, (prop) => OWN.includes(prop) || prop in scene.root, "LearnedScene"), [scene]);
  const unknown = useMemo(() => new UnknownNames("LearnedScene", scene, props.keys(), "environmentRotation"), [scene, props]);
  const names = Object.keys(group).join();
  useEffect(() => unknown.props(names ? names.split(",") : [], (name) => isOfGroup(name, scene.root)), [unknown, names, scene]);
  const others = Object.fromEntries(Object.entries(group).filter(([prop]) => !props.has(prop)));
  const poses = JSON.stringify([movers ?? {}, Object.fromEntries([...props.keys()].map((prop) => [prop, group[prop as Lowercase<string>]]))]);
  useEffect(() => {
    const [values, shares] = JSON.parse(poses) as [Record<string, number>, Record<string, unknown>];
    unknown.movers(Object.keys(values));
    const given = [...props].flatMap(([prop, mover]) => (typeof shares[prop] === "number" ? [[mover, shares[prop]] as const] : []));
    setMovers(scene.movers, (name) => values[name], new Map(given));
  }, [scene, props, unknown, poses]);
  useEffect(() => scene.show(parts ?? ALL), [scene, parts]);
  // None of these is a property of three.js' objects: a canvas with `frameloop="demand"` would not draw the change.
  useEffect(() => invalidate(), [invalidate, scene, x, y, z, day, environmentRotation, settings, poses, parts]);
  return createElement("group", others, createElement("primitive", { object: scene.root }));
}

const ALL: Parts = { raster: true, indirect: true, still: true };
