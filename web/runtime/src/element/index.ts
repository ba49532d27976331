/** `lightwell/element`: defines `<lightwell-viewer src="scene.glb">`. */

import { LightwellViewer } from "./lightwell-viewer.ts";

export { LightwellViewer } from "./lightwell-viewer.ts";

if (!customElements.get("lightwell-viewer")) customElements.define("lightwell-viewer", LightwellViewer);
