/** Learned light in @react-three/fiber: `<Canvas shadows><LearnedModel url="scene.glb" /></Canvas>`. */

import { type ThreeElements, useFrame, useLoader, useThree } from "@react-three/fiber";
import { LearnedScene, LightwellLoaderPlugin } from "lightwell";
import { useEffect, useMemo } from "react";
import { Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

export interface LearnedModelProps {
  readonly url: string;
  /** Place of the first lamp, metres; it stays inside the box in which its light was learned. */
  readonly light?: readonly [number, number, number];
}

export function LearnedModel({ url, light, ...group }: LearnedModelProps & ThreeElements["group"]) {
  const renderer = useThree((state) => state.gl);
  const gltf = useLoader(GLTFLoader, url, (loader) => {
    loader.register((parser) => new LightwellLoaderPlugin(parser));
  });
  const learned = useMemo(() => new LearnedScene(gltf, { renderer }), [gltf, renderer]);
  // Freed with the component; `attach` lights the scene again where React mounts it twice (StrictMode).
  useEffect(() => {
    learned.attach();
    return () => learned.dispose();
  }, [learned]);
  useEffect(() => {
    if (light) learned.lamps[0]?.move(new Vector3(...light));
  }, [learned, light]);
  useFrame(() => learned.update());
  return (
    <group {...group}>
      <primitive object={learned.root} />
    </group>
  );
}
