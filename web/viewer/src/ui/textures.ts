/** The pictures of a file, one by one and channel by channel: what the learned light is made of. */

import type { Viewer } from "../viewer.ts";
import { createSection } from "./controls.ts";
import { el, ICONS, icon } from "./dom.ts";
import { size } from "./numbers.ts";

type Stored = NonNullable<Viewer["learned"]>["pictures"][number];
type Drawable = CanvasImageSource & { width: number; height: number };

/** Channels that can be looked at: all as colours, or one as grey. */
const CHANNELS = ["RGB", "R", "G", "B"] as const;
type Channel = (typeof CHANNELS)[number];

const THUMBNAIL = 64;

/** A thumbnail for every picture; nothing when there is none. */
export function createTextures(viewer: Viewer): HTMLElement[] {
  const pictures = viewer.learned?.pictures ?? [];
  if (pictures.length === 0) return [];
  const thumbnails = pictures.map((picture) => {
    const image = imageOf(picture);
    const canvas = el("canvas", { width: THUMBNAIL, height: THUMBNAIL });
    const context = canvas.getContext("2d")!;
    context.imageSmoothingEnabled = false;
    context.drawImage(image, 0, 0, THUMBNAIL, THUMBNAIL);
    const onclick = () => inspect(picture);
    const label = `${picture.name}, ${image.width} \u00d7 ${image.height}`;
    return el("button", { type: "button", class: "texture", title: label, "aria-label": label, onclick }, canvas);
  });
  return [createSection("Textures", el("div", { class: "textures" }, ...thumbnails))];
}

const imageOf = ({ texture }: Stored): Drawable => texture.image as Drawable;

/** A sheet with the picture as large as the page takes it. */
function inspect(picture: Stored): void {
  const image = imageOf(picture);
  const canvas = el("canvas", { width: image.width, height: image.height });
  canvas.style.aspectRatio = `${image.width} / ${image.height}`;
  const buttons = CHANNELS.map((channel) => {
    const onclick = () => show(channel);
    return el("button", { type: "button", role: "radio", onclick }, channel);
  });
  const show = (channel: Channel) => {
    draw(canvas, image, channel);
    buttons.forEach((button, i) => button.setAttribute("aria-checked", String(CHANNELS[i] === channel)));
  };
  const facts = [`${image.width} \u00d7 ${image.height}`, ...(picture.bytes ? [size(picture.bytes)] : [])];
  const close = el(
    "button",
    { type: "button", class: "round", "aria-label": "Close", onclick: () => sheet.close() },
    icon(ICONS.close),
  );
  const sheet = el(
    "dialog",
    { class: "inspector glass", "aria-label": picture.name },
    el(
      "div",
      { class: "bar" },
      el("h2", {}, picture.name),
      el("span", {}, facts.join(" \u00b7 ")),
      el("div", { class: "modes", role: "radiogroup", "aria-label": "Channel" }, ...buttons),
      close,
    ),
    canvas,
  );
  sheet.addEventListener("close", () => sheet.remove());
  document.body.append(sheet);
  sheet.showModal();
  show("RGB");
}

function draw(canvas: HTMLCanvasElement, image: Drawable, channel: Channel): void {
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(image, 0, 0);
  if (channel === "RGB") return;
  const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
  const at = CHANNELS.indexOf(channel) - 1;
  for (let i = 0; i < pixels.data.length; i += 4) pixels.data.fill(pixels.data[i + at]!, i, i + 3);
  context.putImageData(pixels, 0, 0);
}
