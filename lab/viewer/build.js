// Bundles what draws a scene in a page, and writes it to desplat_ns/tools/scene/viewer.
import { readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";
import { build } from "esbuild";

const output = new URL("../../desplat_ns/tools/scene/viewer/", import.meta.url);
const modules = new URL("node_modules/", import.meta.url);
let wasm;

// Spark holds its WebAssembly as text. As bytes beside the script, which the page hands over in
// SPARK_WASM, it is compressed to half of that, and no browser reads it as a program.
const spark = {
  name: "spark",
  setup: ({ onLoad }) => onLoad({ filter: /spark\.module\.js$/ }, ({ path }) => {
    const text = readFileSync(path, "utf8");
    const [call, embedded] = text.match(/decode64\("([A-Za-z0-9+/=]+)"\)/);
    // Its messages name folders and hosts of the machine that compiled it.
    wasm = Buffer.from(embedded, "base64").toString("latin1")
      .replace(/\/Users\/\w+\/|index\.[a-z]+\.io/g, (name) => "-".repeat(name.length));
    return { contents: text.replace(call, () => "globalThis.SPARK_WASM") };
  }),
};

const bundled = await build({
  entryPoints: ["entry.js"], plugins: [spark], bundle: true, minify: true, write: false,
  format: "iife", globalName: "Viewer", target: "es2020", legalComments: "none",
});

const licences = ["@sparkjsdev/spark", "three", "fflate"].map((name) => {
  const { version } = JSON.parse(readFileSync(new URL(`${name}/package.json`, modules)));
  const text = readFileSync(new URL(`${name}/LICENSE`, modules), "utf8");
  return `${name} ${version}\n\n${text.trim()}\n`;
});
licences.unshift("The files beside this one are built from the work of others (make viewer).\n");

const write = (name, content) => writeFileSync(new URL(name, output), content);
write("viewer.js.gz", gzipSync(bundled.outputFiles[0].contents, { level: 9 }));
write("spark.wasm.gz", gzipSync(Buffer.from(wasm, "latin1"), { level: 9 }));
write("LICENSES.txt", licences.join(`\n${"-".repeat(80)}\n\n`));
