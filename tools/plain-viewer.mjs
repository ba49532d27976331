// A scene as any glTF viewer shows it, which knows nothing of learned light: node tools/plain-viewer.mjs OUT.png SCENE.glb WIDTHxHEIGHT
// three.js with its glTF loader alone, the first camera of the file, and light from all sides, as viewers have it.
// Needs the web tests' packages and a Chromium.
import { existsSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(new URL("../web/package.json", import.meta.url));
const { chromium } = require("playwright-core");
const three = new URL("../web/node_modules/three/", import.meta.url);
const [out, scene, size] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const PAGE = `<!doctype html><style>body { margin: 0 }</style>
<script type="importmap">{ "imports": { "three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/" } }</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
const gltf = await new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).loadAsync("/scene.glb");
const scene = gltf.scene;
scene.background = new THREE.Color(0xd8dade);
scene.add(new THREE.HemisphereLight(0xffffff, 0xb0a89c, 2.6));
const camera = gltf.cameras[0];
camera.aspect = innerWidth / innerHeight;
camera.updateProjectionMatrix();
scene.updateMatrixWorld();
renderer.render(scene, camera);
window.drawn = true;
</script>`;
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--use-angle=gl-egl", "--ignore-gpu-blocklist"] });
const tab = await browser.newPage({ viewport: { width, height } });
tab.setDefaultTimeout(600_000);
tab.on("pageerror", (error) => console.error(String(error)));
await tab.route("http://viewer.test/**", (route) => {
  const path = new URL(route.request().url()).pathname;
  if (path === "/") return route.fulfill({ contentType: "text/html", body: PAGE });
  if (path === "/scene.glb") return route.fulfill({ body: readFileSync(scene) });
  if (path.startsWith("/three/")) return route.fulfill({ contentType: "text/javascript", body: readFileSync(new URL(path.slice(7), three)) });
  return route.fulfill({ status: 404, body: "" });
});
await tab.goto("http://viewer.test/");
await tab.waitForFunction(() => window.drawn);
await tab.screenshot({ path: out, timeout: 600_000 });
await browser.close();
