/** What a file without learned light declares. */

import type { NeuralRadiance } from "./extension.ts";

export const NO_LIGHT: NeuralRadiance = { variables: [], movers: [], lamps: [], fields: [], probes: [], exposure: null, core: null, environment: null };
