// How Gaussians are drawn: as in training, by Spark.
// @ts-check
import { layoutOf } from "./files.js";

/** Standard deviations at which a Gaussian of full opacity falls below 1/255. */
const REACH_SIGMAS = Math.sqrt(2 * Math.log(255));
/** A Gaussian beside the image is drawn as long as its centre is within so many times its half... */
const BESIDE = 10;
/** ... and its projection linearized at a place within so many times it, as in training: beyond, the
 * linearization would smear it over the image. Spark takes the centre itself. */
const LINEARIZED_WITHIN = 1.3;
const SPARKS_JACOBIAN = "vec2 J2 = -(J1 * viewCenter.xy) * invZ;";
const CLAMPED_JACOBIAN = `vec2 J2 = J1 * (
  clamp(clipCenter.xy / clipCenter.w, -${LINEARIZED_WITHIN}, ${LINEARIZED_WITHIN})
  + vec2(projectionMatrix[2][0], projectionMatrix[2][1]))
  / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);`;

/** @param {any} V the library @param {HTMLCanvasElement} canvas */
export function newRenderer(V, canvas) {
  V.ColorManagement.workingColorSpace = "srgb";  // Gaussians are blended as they were trained
  const renderer = new V.WebGLRenderer({ canvas, antialias: false });
  renderer.autoClear = false;
  return renderer;
}

/** What is drawn on, and how it comes to the screen. Hundreds of faint Gaussians over one another
 * would be rounded to 8 bits one after the other; where the graphics can, it is done in 16.
 * @param {any} V @param {any} renderer */
export function newTarget(V, renderer) {
  const fine = ["EXT_color_buffer_float", "EXT_color_buffer_half_float"];
  if (!fine.some(name => renderer.extensions.has(name))) return null;
  const target = new V.WebGLRenderTarget(1, 1, { type: V.HalfFloatType });
  const quad = new V.FullScreenQuad(new V.ShaderMaterial({
    uniforms: { drawn: { value: target.texture } }, depthTest: false, depthWrite: false,
    vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position, 1.0); }",
    fragmentShader: "uniform sampler2D drawn; varying vec2 at;"
      + " void main() { gl_FragColor = vec4(texture2D(drawn, at).rgb, 1.0); }",
  }));
  return { target, quad };
}

/** A scene of Gaussians, with what sorts and draws them.
 * @param {any} V @param {any} renderer @param {boolean} antialiased @param {() => void} onDirty */
export function newLayer(V, renderer, antialiased, onDirty) {
  const scene = new V.Scene();
  const spark = new V.SparkRenderer({
    renderer, onDirty,
    maxStdDev: REACH_SIGMAS, minAlpha: 1 / 255, maxPixelRadius: 4096, clipXY: BESIDE,
    // the EWA filter of training; with antialiasing it takes opacity in exchange
    preBlurAmount: antialiased ? 0 : 0.3, blurAmount: antialiased ? 0.3 : 0,
    sortRadial: false, enableLod: false, accumExtSplats: true,
  });
  const { material } = spark, shader = material.vertexShader;
  material.vertexShader = shader.replace(SPARKS_JACOBIAN, CLAMPED_JACOBIAN);
  if (material.vertexShader === shader) throw new Error("Spark's shader is another one");
  scene.add(spark);
  return { scene, spark };
}

/** @param {any} V @param {Uint8Array} spz @param {Uint8Array} unpacked the same */
export async function newSplats(V, spz, unpacked) {
  const mesh = new V.SplatMesh({ fileBytes: spz, fileType: "spz", extSplats: true });
  await mesh.initialized;
  mendHarmonics(mesh.extSplats.extra, unpacked);
  return mesh;
}

/** @param {any} V the library @param {File} file that is not from this page: .ply or .spz */
export async function droppedSplats(V, file) {
  const kind = file.name.toLowerCase().split(".").pop() ?? "";
  if (!["ply", "spz"].includes(kind)) throw new Error("drop a .ply or a .spz file.");
  const fileBytes = new Uint8Array(await file.arrayBuffer());
  const mesh = new V.SplatMesh({ fileBytes, fileType: kind, extSplats: true });
  await mesh.initialized;
  if (!mesh.numSplats) throw new Error("it holds no Gaussians.");
  if (kind === "ply") mesh.quaternion.set(1, 0, 0, 0); // y is down in it
  return mesh;
}

/** The middle of a mesh, and twice the median distance of its Gaussians from there; both in the
 * world. @param {any} V the library @param {any} mesh */
export function extentOf(V, mesh) {
  const places = /** @type {any[]} */ ([]), step = Math.ceil(mesh.numSplats / 10_000);
  mesh.forEachSplat((i, place) => i % step || places.push(place.clone()));
  const median = values => values.sort((a, b) => a - b)[values.length >> 1];
  const middle = new V.Vector3(...["x", "y", "z"].map(axis => median(places.map(p => p[axis]))));
  const reach = 2 * median(places.map(place => place.distanceTo(middle)));
  return { middle: middle.applyQuaternion(mesh.quaternion), reach };
}

/** Write harmonics anew as Spark keeps them: in a word for each coefficient, three magnitudes in
 * 255ths of a power of two, then three signs and the exponent (plus 15). Spark 2.2.0 takes the power
 * below the largest of the three, where it cuts off: up to a half is lost. This takes the one above.
 * @param {Record<string, Uint32Array>} words four for each Gaussian in each array
 * @param {Uint8Array} spz unpacked, where a byte is 128 and 128ths of a coefficient */
export function mendHarmonics(words, spz) {
  const { count, harmonics } = layoutOf(spz), each = (spz.length - harmonics) / (3 * count);
  const arrays = ["sh1", "sh2", "sh3a", "sh3b"].map(name => words[name]);
  for (let i = 0, at = harmonics; i < count; i++)
    for (let k = 0; k < each; k++, at += 3) {
      const [r, g, b] = [spz[at] - 128, spz[at + 1] - 128, spz[at + 2] - 128];
      const most = Math.max(Math.abs(r), Math.abs(g), Math.abs(b), 1);
      const bits = 32 - Math.clz32(most - 1), scale = 255 / 2 ** bits; // most <= 2^bits
      const size = value => Math.round(Math.abs(value) * scale);
      const signs = (r < 0 ? 1 : 0) | (g < 0 ? 2 : 0) | (b < 0 ? 4 : 0);
      arrays[k >> 2][4 * i + (k & 3)] = size(r) | size(g) << 8 | size(b) << 16
        | signs << 24 | (bits - 7 + 15) << 27;
    }
}
