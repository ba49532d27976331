// What the pages around a snippet have: names that it may use without an import.
import type * as ADDONS from "three/addons/loaders/GLTFLoader.js";
import type * as THREE from "three";
import type * as LIGHTWELL from "lightwell";
import type * as NODES from "lightwell/webgpu";
import type * as LENS from "lightwell/lens";
import type * as FIBER from "@react-three/fiber";
import type * as REACT from "react";

declare global {
  const GLTFLoader: typeof ADDONS.GLTFLoader;
  const AgXToneMapping: typeof THREE.AgXToneMapping;
  const LearnedScene: typeof LIGHTWELL.LearnedScene;
  const LightwellLoaderPlugin: typeof LIGHTWELL.LightwellLoaderPlugin;
  const parseLearned: typeof LIGHTWELL.parseLearned;
  const learnedRadiance: typeof NODES.learnedRadiance;
  const Lens: typeof LENS.Lens;
  const readLibrary: typeof LENS.readLibrary;
  const Canvas: typeof FIBER.Canvas;
  const Suspense: typeof REACT.Suspense;
  const Vector3: typeof THREE.Vector3;
  const renderer: THREE.WebGLRenderer;
  const scene: THREE.Scene;
  const camera: THREE.PerspectiveCamera;
  const mesh: THREE.Mesh<THREE.BufferGeometry, THREE.MeshStandardMaterial>;
  const loader: ADDONS.GLTFLoader;
  const parser: ADDONS.GLTFParser;
  const bytes: ArrayBuffer;
  const device: GPUDevice;
  const color: GPUTexture;
  const depth: GPUTexture;
  const picture: GPUTexture;
  const encoder: GPUCommandEncoder;
  const near: number;
  const far: number;
  const width: number;
  const height: number;
  // A scene of either renderer, and what three.js' own types leave open.
  // biome-ignore lint/suspicious/noExplicitAny: as said.
  const learned: any;
  const material: any;
  const pass: any;
  const pipeline: any;
}
