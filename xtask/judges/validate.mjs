// Shows GLB files to Khronos' validator. Exit code 1 on any error or warning.
//
//   npm install && node validate.mjs FILE...

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import validator from "gltf-validator";

const files = process.argv.slice(2);
let failed = files.length === 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
    uri: basename(file),
    maxIssues: 20,
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  const { totalVertexCount, totalTriangleCount, animationCount } = report.info;
  console.log(
    `${basename(file)}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos, ${numHints} hints ` +
      `(${animationCount} animation, ${totalVertexCount} vertices, ${totalTriangleCount} triangles)`,
  );
  for (const { code, message, pointer } of messages) {
    console.log(`  ${code} at ${pointer ?? "the file"}: ${message}`);
  }
  failed ||= numErrors + numWarnings > 0;
}
process.exit(failed ? 1 : 0);
