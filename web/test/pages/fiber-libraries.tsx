/** `lightwell/react` under StrictMode and Suspense together with drei and @react-three/postprocessing, and the same room in plain three.js. */

import { Environment, Lightformer, OrbitControls } from "@react-three/drei";
import { Canvas } from "@react-three/fiber";
import { EffectComposer, HueSaturation, ToneMapping } from "@react-three/postprocessing";
import { type LearnedScene as Learned, LightwellLoaderPlugin, LearnedScene as PlainScene } from "lightwell";
import { LearnedScene } from "lightwell/react";
import { ToneMappingMode } from "postprocessing";
import { StrictMode, Suspense, useEffect } from "react";
import { createRoot } from "react-dom/client";
import { AgXToneMapping, type Camera, type Light, type Material, Mesh, type Object3D, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const [WIDTH, HEIGHT, FOV] = [160, 120, 36];
const EXPOSURE = 1.5;
const TARGET = [0, 1, 0] as const;
const LIGHT = [0.3, 1.2, 0.2] as const;

/** What hangs on the canvas. */
export interface Setting {
  /** Address of the room; none of it unless given. */
  readonly src?: string | undefined;
  /** An environment of drei: a lamp of its own scene, or a picture of a file. */
  readonly environment?: "lamp" | "file";
  /** What `<LearnedScene>` does with it. */
  readonly policy?: "keep" | "remove";
  /** OrbitControls of drei. */
  readonly controls?: boolean;
  /** Effects of @react-three/postprocessing: a tone curve, and colours taken away before it. */
  readonly effects?: "curve" | "grey";
  readonly light?: readonly [number, number, number];
  readonly frameloop?: "always" | "demand";
}

/** What a test looks at. */
export interface Found {
  /** How often effects ran on the canvas: twice at every mount where StrictMode counts. */
  effects: number;
  waited: boolean;
  scene: Learned | null;
  camera: Camera | null;
  gl: WebGLRenderer | null;
  world: Scene | null;
}

const found: Found = { effects: 0, waited: false, scene: null, camera: null, gl: null, world: null };
const box = document.getElementById("root")!;
let root = createRoot(box);

function Waiting() {
  found.waited = true;
  return null;
}

function Count() {
  useEffect(() => void found.effects++, []);
  return null;
}

function Map({ kind }: { readonly kind: "lamp" | "file" }) {
  if (kind === "file") return <Environment files="/sky.hdr" />;
  return (
    <Environment resolution={32}>
      <Lightformer form="rect" intensity={6} scale={[8, 8, 1]} position={[0, 2, 6]} target={[0, 0, 0]} />
    </Environment>
  );
}

function World({ src, environment, policy, controls, effects, light = LIGHT, frameloop = "always" }: Setting) {
  return (
    <Canvas
      shadows
      dpr={1}
      frameloop={frameloop}
      gl={{ antialias: false, preserveDrawingBuffer: true, toneMapping: AgXToneMapping, toneMappingExposure: EXPOSURE }}
      camera={{ position: [0, 1, 4.2], fov: FOV, near: 0.01, far: 100 }}
      onCreated={({ gl, camera, scene }) => {
        camera.lookAt(...TARGET);
        Object.assign(found, { gl, camera, world: scene });
      }}
    >
      <Suspense fallback={<Waiting />}>
        {src && <Count />}
        {src && <LearnedScene src={src} light={light} {...(policy ? { environment: policy } : {})} ref={(scene) => void (found.scene = scene)} />}
        {environment && <Map kind={environment} />}
        {effects && (
          <EffectComposer multisampling={0}>
            {effects === "grey" ? <HueSaturation saturation={-1} /> : <></>}
            <ToneMapping mode={ToneMappingMode.AGX} />
          </EffectComposer>
        )}
      </Suspense>
      {controls && <OrbitControls makeDefault target={TARGET} enableDamping={false} />}
    </Canvas>
  );
}

/** Put a setting on the canvas. */
function show(setting: Setting): void {
  uncover();
  root.render(
    <StrictMode>
      <World {...setting} />
    </StrictMode>,
  );
}

/** Take the whole canvas away. */
function leave(): void {
  root.unmount();
  root = createRoot(box);
}

let plain: WebGLRenderer | null = null;

/** Take the canvas of plain three.js away. */
function uncover(): void {
  plain?.domElement.remove();
  plain?.dispose();
  plain?.forceContextLoss();
  plain = null;
}

/** The room as plain three.js draws it from the place of a camera, laid over the canvas of React. */
async function showPlain(src: string, position: readonly [number, number, number]): Promise<void> {
  uncover();
  const renderer = new WebGLRenderer({ alpha: true, antialias: false, preserveDrawingBuffer: true });
  plain = renderer;
  renderer.setSize(WIDTH, HEIGHT);
  renderer.shadowMap.enabled = true;
  renderer.toneMapping = AgXToneMapping;
  renderer.toneMappingExposure = EXPOSURE;
  const gltf = await new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, { renderer })).loadAsync(src);
  const learned = new PlainScene(gltf, { renderer });
  learned.lamps[0]?.move(new Vector3(...LIGHT));
  const scene = new Scene();
  scene.add(learned.root);
  const camera = new PerspectiveCamera(FOV, WIDTH / HEIGHT, 0.01, 100);
  camera.position.set(...position);
  camera.lookAt(...TARGET);
  learned.update();
  renderer.render(scene, camera);
  Object.assign(renderer.domElement.style, { position: "fixed", inset: "0", background: "white" });
  document.body.append(renderer.domElement);
}

/** What a model has of its own, to be held against what it was loaded with. */
function stateOf(model: Object3D) {
  const [materials, lights, shadows] = [new Set<Material>(), [] as Light[], [] as boolean[]];
  model.traverse((object) => {
    if ((object as Light).isLight) lights.push(object as Light);
    if (!(object instanceof Mesh)) return;
    for (const material of [object.material].flat()) materials.add(material);
    shadows.push(object.castShadow, object.receiveShadow);
  });
  return {
    patched: [...materials].filter((material) => Object.hasOwn(material, "onBeforeCompile") || Object.hasOwn(material, "customProgramCacheKey")).length,
    sides: [...materials].filter(({ shadowSide }) => shadowSide !== null).length,
    lights: lights.length,
    shadows: shadows.filter(Boolean).length,
  };
}

declare global {
  interface Window {
    fiber: { found: Found; show: typeof show; leave: typeof leave; showPlain: typeof showPlain; stateOf: typeof stateOf };
  }
}

window.fiber = { found, show, leave, showPlain, stateOf };
