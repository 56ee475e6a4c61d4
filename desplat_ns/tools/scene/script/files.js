// What the page holds as text, and how it becomes files again.
// @ts-check

/** An element of the page. @param {string} id @returns {any} */
export const $ = id => document.getElementById(id);

/** @param {string} text of base64 */
export function bytesOf(text) {
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

/** @param {string} id of a script element with a file in it */
export const embedded = id => bytesOf($(id).textContent);

/** @param {Uint8Array} bytes of a gzip file */
export const inflated = bytes => through(new DecompressionStream("gzip"), bytes);

/** @param {Uint8Array} bytes to make a gzip file of */
export const deflated = bytes => through(new CompressionStream("gzip"), bytes);

/** @param {GenericTransformStream} stream @param {any} bytes @returns {Promise<Uint8Array>} */
async function through(stream, bytes) {
  const read = new Blob([bytes]).stream().pipeThrough(/** @type {any} */ (stream));
  return new Uint8Array(await new Response(read).arrayBuffer());
}

// An SPZ, unpacked: a header with the number of Gaussians, then of all their places and opacities,
// their colours, their scales and turns, and their harmonics.
const HEADER = 16, COUNT_AT = 8;
const BEFORE_COLOURS = 10, COLOURS = 3, BEFORE_HARMONICS = 7; // bytes of each Gaussian

/** Where in an SPZ colours and harmonics begin, and of how many Gaussians.
 * @param {Uint8Array} spz unpacked */
export function layoutOf(spz) {
  const count = new DataView(spz.buffer).getUint32(COUNT_AT, true);
  const colours = HEADER + BEFORE_COLOURS * count;
  return { count, colours, harmonics: colours + (COLOURS + BEFORE_HARMONICS) * count };
}

/** A scene in another light.
 * @param {Uint8Array} scene an SPZ, unpacked
 * @param {Uint8Array} change what is to be added to its colours, then its harmonics, modulo 256 */
export function relit(scene, change) {
  const lit = scene.slice(), { count, colours, harmonics } = layoutOf(scene);
  const after = COLOURS * count;
  for (let i = 0; i < change.length; i++)
    lit[i < after ? colours + i : harmonics + i - after] += change[i]; // bytes wrap around
  return lit;
}

/** Run the libraries: they leave a global `Viewer`. */
export async function loadViewer() {
  const world = /** @type {any} */ (globalThis);
  world.SPARK_WASM = await inflated(embedded("wasm"));
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await inflated(embedded("viewer")))
    + "\nglobalThis.Viewer = Viewer;";
  document.head.append(script);
  return world.Viewer;
}

/** Why this browser cannot draw the scene; empty if it can. */
export function obstacle() {
  if (!document.createElement("canvas").getContext("webgl2"))
    return "This browser cannot draw the scene: it has no WebGL 2, or it is switched off.";
  if (!globalThis.DecompressionStream || !globalThis.WebAssembly)
    return "This browser is too old to draw the scene.";
  return "";
}
