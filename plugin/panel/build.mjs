// Bundles src/ into ../public/build: main.js, which WebODM's SystemJS loads as AMD, and main.css.
// React, ReactDOM and Leaflet are WebODM's own, by the names that it gives them; a second copy of
// React would not share its events with the map's.
import { fileURLToPath } from "node:url";
import path from "node:path";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const outdir = process.argv[2] ? path.resolve(process.argv[2]) : path.join(here, "../public/build");
const theirs = { React: "React", ReactDOM: "ReactDOM", leaflet: "L" };

const givenByWebODM = {
  name: "given-by-webodm",
  setup(bundler) {
    bundler.onResolve({ filter: /^(React|ReactDOM|leaflet)$/ }, ({ path: name }) => ({
      path: name,
      namespace: "webodm",
    }));
    bundler.onLoad({ filter: /.*/, namespace: "webodm" }, ({ path: name }) => ({
      contents: `module.exports = ${theirs[name]};`,
    }));
  },
};

const names = Object.keys(theirs);
await build({
  absWorkingDir: here,
  entryPoints: { main: "src/index.jsx" },
  outdir,
  bundle: true,
  minify: true,
  charset: "utf8",
  target: ["chrome80", "firefox78", "safari14.1"],
  format: "iife",
  globalName: "volcalc",
  jsxFactory: "React.createElement",
  jsxFragment: "React.Fragment",
  plugins: [givenByWebODM],
  banner: { js: `define(${JSON.stringify(names)},function(${Object.values(theirs)}){` },
  footer: { js: "return volcalc;});" },
  legalComments: "none",
  logLevel: "warning",
});
