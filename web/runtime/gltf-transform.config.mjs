// For glTF-Transform's command line, which drops extensions that it does not know:
// gltf-transform webp scene.glb small.glb --config node_modules/lightwell/gltf-transform.config.mjs
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { Lightmap, NeuralRadiance } from "lightwell/gltf-transform";

export default { extensions: [...ALL_EXTENSIONS, NeuralRadiance, Lightmap] };
