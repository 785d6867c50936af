// Bundles the viewer into viewer.min.js. Its first line has a hash of everything it is made from, which a test checks:
// `cargo test --test commands viewer`.

import { readFileSync, readdirSync } from "node:fs";
import { build } from "esbuild";

const sources = ["build.mjs", "package.json", "package-lock.json"];
sources.push(...readdirSync("viewer").sort().map((name) => `viewer/${name}`));

// FNV-1a with 64 bits, of each name and each file with a zero behind it.
let hash = 0xcbf29ce484222325n;
for (const name of sources) {
  for (const part of [Buffer.from(name), readFileSync(name)]) {
    for (const byte of [...part, 0]) {
      hash = BigInt.asUintN(64, (hash ^ BigInt(byte)) * 0x100000001b3n);
    }
  }
}

await build({
  entryPoints: ["viewer/main.js"],
  outfile: "viewer.min.js",
  banner: { js: `/* sources ${hash.toString(16).padStart(16, "0")} */` },
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2020",
  legalComments: "inline",
});
