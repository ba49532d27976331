/** Learned light in @react-three/fiber, with a lamp that circles. */

import { Canvas, useFrame } from "@react-three/fiber";
import type { LearnedScene as Learned } from "lightwell";
import { LearnedScene } from "lightwell/react";
import { Suspense, useRef } from "react";
import { Vector3 } from "three";

function Room({ src }: { readonly src: string }) {
  const scene = useRef<Learned>(null);
  useFrame(({ clock }) => {
    const t = clock.elapsedTime;
    scene.current?.lamps[0]?.move(new Vector3(0.5 * Math.cos(t), 1.2, 0.5 * Math.sin(t)));
  });
  return <LearnedScene ref={scene} src={src} />;
}

export function App({ src = "scene.glb" }: { readonly src?: string }) {
  return (
    <Canvas shadows camera={{ position: [0, 1, 4.2], fov: 36 }} onCreated={({ camera }) => camera.lookAt(0, 1, 0)}>
      <Suspense fallback={null}>
        <Room src={src} />
      </Suspense>
    </Canvas>
  );
}
