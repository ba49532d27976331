/** The React example on a page. */

import { Canvas } from "@react-three/fiber";
import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { LearnedModel } from "../../../examples/web/fiber.tsx";

const root = createRoot(document.getElementById("root")!);
const url = document.body.dataset.src!;
Object.assign(window, { unmount: () => root.render(null) });
root.render(
  <StrictMode>
  <Canvas shadows frameloop="always" gl={{ preserveDrawingBuffer: true }} camera={{ position: [0, 1, 4.2], fov: 36 }} onCreated={({ gl, camera }) => {
    camera.lookAt(0, 1, 0);
    Object.assign(window, { gl });
  }}>
    <LearnedModel url={url} light={[0.3, 1.2, 0.2]} />
  </Canvas>
  </StrictMode>,
);
