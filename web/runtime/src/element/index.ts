/** `lightwell/element`: defines `<lightwell-viewer src="scene.glb">`. */

import { LightwellViewer } from "./lightwell-viewer.ts";

export { LightwellViewer } from "./lightwell-viewer.ts";

if (globalThis.customElements && !customElements.get("lightwell-viewer")) customElements.define("lightwell-viewer", LightwellViewer);
