// Holds GLB files against the official validator: node tests/gltf/validate.mjs FILE.glb … Errors and warnings fail; NODE_PATH names the folder of the package `gltf-validator`.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const folder = process.env.NODE_PATH ?? "node_modules";
const validator = createRequire(import.meta.url)(join(folder, "gltf-validator"));
let n_faults = 0;
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), { maxIssues: 0 });
  const { numErrors, numWarnings, numInfos, messages } = report.issues;
  console.log(`${path}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} remarks; ${report.info.animationCount} animation, ${report.info.drawCallCount} meshes drawn`);
  // 0: error, 1: warning.
  for (const it of messages.filter((it) => it.severity < 2).slice(0, 20)) {
    console.log(`  ${it.code} at ${it.pointer ?? it.offset}: ${it.message}`);
  }
  n_faults += numErrors + numWarnings;
}
if (process.argv.length < 3) {
  console.error("expected the names of GLB files");
  n_faults = 1;
}
process.exit(n_faults === 0 ? 0 : 1);
