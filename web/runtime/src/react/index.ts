/** `lightwell/react`: learned light in @react-three/fiber. */

export { LearnedScene, type LearnedSceneProps, useLearnedScene, type UseLearnedSceneOptions } from "./learned-scene.ts";
