// Runs the Khronos glTF validator on the file named first; the folder that holds node_modules is named second.
// Prints the report's issues as JSON.
import { createRequire } from 'node:module';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';

const [file, root] = process.argv.slice(2);
const validator = createRequire(join(root, 'noop.js'))('gltf-validator');
const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 100 });
console.log(JSON.stringify({ issues: report.issues, info: report.info }));
