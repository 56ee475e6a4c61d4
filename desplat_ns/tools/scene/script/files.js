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

/** @param {any} bytes of a gzip file @returns {Promise<Uint8Array>} */
export async function inflated(bytes) {
  const stream = new DecompressionStream("gzip");
  const read = new Blob([bytes]).stream().pipeThrough(/** @type {any} */ (stream));
  return new Uint8Array(await new Response(read).arrayBuffer());
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
