/** `lightwell/react` on a page, under StrictMode, and what happens when it is unmounted, mounted again, or given a broken file. */

import { Canvas } from "@react-three/fiber";
import type { LearnedScene as Learned } from "lightwell";
import { LearnedScene, type LearnedSceneProps } from "lightwell/react";
import { Component, type ReactNode, StrictMode, Suspense } from "react";
import { createRoot } from "react-dom/client";

const found: { gl?: unknown; scene?: Learned | null; waited?: boolean; error?: string } = {};

class Boundary extends Component<{ children: ReactNode }> {
  override state = { failed: false };
  static getDerivedStateFromError(error: Error) {
    found.error = error.message;
    return { failed: true };
  }
  override render() {
    return this.state.failed ? null : this.props.children;
  }
}

function Waiting() {
  found.waited = true;
  return null;
}

const root = createRoot(document.getElementById("root")!);
const show = (src: string | null, at: [number, number, number] = [0, 0, 0], more: Partial<LearnedSceneProps> = {}) =>
  root.render(
    <StrictMode>
      <Canvas
        shadows
        frameloop="always"
        gl={{ preserveDrawingBuffer: true }}
        camera={{ position: [0, 1, 4.2], fov: 36 }}
        onCreated={({ gl, camera }) => {
          camera.lookAt(0, 1, 0);
          found.gl = gl;
        }}
      >
        <Boundary>
          <Suspense fallback={<Waiting />}>
            {src && <LearnedScene src={src} position={at} light={[0.3, 1.2, 0.2]} ref={(scene) => void (found.scene = scene)} {...more} />}
          </Suspense>
        </Boundary>
      </Canvas>
    </StrictMode>,
  );
Object.assign(window, { found, show });
show(document.body.dataset.src!);
