// A scene to walk around in. Everything it needs is in the page: `data` (cameras with their photos
// and what was taken out of each, lights), `scene` (SPZ), `wasm` and `viewer` (libraries).
// @ts-check
import { $, bytesOf, deflated, embedded, inflated, loadViewer, obstacle, relit } from "./files.js";
import { GONE, NEAREST, WHOLE, away, falling, frameOf, nearPlane, setLens, standAt }
  from "./cameras.js";
import { droppedSplats, extentOf, newLayer, newRenderer, newSplats, newTarget } from "./drawing.js";
import { newFrusta } from "./frusta.js";
import { Controls, listen } from "./controls.js";

/** @typedef {{name: string, background: [number, number, number], change: string}} Light
 *   the change is one of colours, for `relit`; empty for the first light */

const PATIENCE = 60_000; // milliseconds until the first picture
const QUIET = 200; // milliseconds without a drawing after which nothing more comes
const SLOW = 100; // milliseconds between two pictures of a move, above which they get coarser
const COARSEST = 4; // times fewer pixels to a side
const WHY_FADING = "What was taken out was made for this view alone: nobody knows how it looks from "
  + "elsewhere, so it fades as you leave.";

export class ScenePage {
  /** @param {any} V the library
   * @param {{cameras: import("./cameras.js").PhotoCamera[], lights: Light[], antialiased: boolean}}
   *   data */
  constructor(V, data) {
    this.V = V;
    this.cameras = data.cameras;
    this.lights = data.lights;
    this.renderer = newRenderer(V, $("canvas"));
    this.camera = new V.PerspectiveCamera();
    this.camera.matrixAutoUpdate = true;
    this.canvas = newTarget(V, this.renderer);
    // Two scenes, so that what was taken out lies in front, whatever its depth, as in training.
    const layer = () => newLayer(V, this.renderer, data.antialiased, () => this.redraw());
    this.still = layer();
    this.front = layer();
    /** @type {any} the scene in the light that is shown */
    this.lit = null;
    /** @type {any} */
    this.frusta = null;
    this.taken = new Map();
    this.loading = new Set();
    this.current = 0;
    this.light = 0;
    this.queued = false;
    this.lastDraw = 0;
    this.lastPose = new V.Matrix4();
    this.coarser = 1;
    /** Whether the last picture asked for another one at once. */
    this.going = false;
    /** @type {() => void} */
    this.isReady = () => {};
    this.ready = new Promise(done => { this.isReady = () => done(undefined); });
    this.controls = new Controls(V, this.camera, () => this.redraw());
    listen(this);
    new ResizeObserver(() => this.resize()).observe($("stage"));
    $("canvas").addEventListener("webglcontextlost", () =>
      fail("The browser took the graphics away from this page. Load it again."));
  }

  // --- where one is --------------------------------------------------------------------------

  /** Go to a photo's camera. @param {number} index */
  goTo(index) {
    const one = this.cameras[index];
    this.current = index;
    this.controls.aim(standAt(this.V, this.camera, one), one.reach);
    $("photo").src = one.photo;
    $("photo").alt = `The photo ${one.name}`;
    $("camera").value = String(index);
    $("distractors").disabled = !one.distractors;
    this.showTaken();
    this.resize();
  }

  /** @param {number} by photos on, or back */
  step(by) {
    const count = this.cameras.length;
    this.goTo((this.current + by + count) % count);
  }

  /** @param {boolean} flying */
  setMode(flying) { this.controls.setMode(flying); }

  resize() {
    const stage = $("stage"), at = frameOf(this.cameras[this.current], stage);
    if (!stage.clientWidth || !stage.clientHeight) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) / this.coarser);
    this.renderer.setSize(stage.clientWidth, stage.clientHeight, false);
    this.canvas?.target.setSize($("canvas").width, $("canvas").height);
    Object.assign($("photo").style, {
      left: `${at.left}px`, top: `${at.top}px`, width: `${at.width}px`, height: `${at.height}px` });
    this.redraw();
  }

  // --- what is shown -------------------------------------------------------------------------

  redraw() {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.queued = false;
    const { V, camera, renderer, still, front } = this, one = this.cameras[this.current];
    const moved = this.controls.move();
    camera.updateMatrixWorld();
    this.suitSpeed();
    renderer.setRenderTarget(this.canvas?.target ?? null);
    renderer.clear();
    setLens(camera, one, $("stage"), nearPlane(V, camera, this.cameras));
    renderer.render(still.scene, camera);
    const far = away(V, camera, one), whole = falling(far, WHOLE, GONE);
    const mesh = this.taken.get(this.current);
    if (mesh?.visible && whole > 0) {
      mesh.opacity = whole;
      setLens(camera, one, $("stage"), NEAREST);
      renderer.render(front.scene, camera);
    }
    renderer.setRenderTarget(null);
    this.canvas?.quad.render(renderer);
    $("photo").style.opacity = falling(far, 0.005, WHOLE);
    $("photo").hidden = $("share").value === "0";
    this.tell(far);
    this.going = moved || this.controls.awake;
    if (this.going) this.redraw();
    if (still.spark.activeSplats > 0) this.isReady();
  }

  /** Draw fewer pixels while a move takes long to draw, and all of them at rest. */
  suitSpeed() {
    const now = performance.now(), moves = !this.lastPose.equals(this.camera.matrixWorld);
    const before = this.coarser, slow = this.going && now - this.lastDraw > SLOW;
    if (moves && slow && before < COARSEST) this.coarser *= 2;
    if (!moves && !this.controls.awake) this.coarser = 1;
    this.lastPose.copy(this.camera.matrixWorld);
    this.lastDraw = now;
    if (this.coarser !== before) this.resize();
  }

  /** Say where one is. @param {number} far from the current photo's camera */
  tell(far) {
    const one = this.cameras[this.current], kind = one.heldOut ? "held-out" : "training photo";
    const place = !one.photo ? one.name : far < WHOLE ? `At ${one.name} (${kind}).` : `Away from ${one.name}.`;
    const fading = $("distractors").checked && one.distractors ? ` ${WHY_FADING}` : "";
    const text = place + fading;
    if ($("note").textContent !== text) $("note").textContent = text;
  }

  /** Show the scene in another light, or go on in this one where there is no memory for it.
   * @param {number} index */
  async chooseLight(index) {
    const before = this.light;
    try {
      await this.showLight(index);
    } catch (error) {
      console.error(error);
      this.loading.delete("light");
      this.light = before;
      $("light").value = String(before);
    }
  }

  /** Show the scene in one of its lights. @param {number} index */
  async showLight(index) {
    const { name, background, change } = this.lights[index];
    this.light = index;
    if ($("light")) $("light").value = String(index); // browsers keep a choice when they reload
    let scene = embedded("scene"), unpacked = await inflated(scene);
    this.loading.add("light");
    if (change) {
      unpacked = relit(unpacked, await inflated(bytesOf(change)));
      scene = await deflated(unpacked);
    }
    const mesh = await newSplats(this.V, scene, unpacked);
    if (this.light !== index) return mesh.dispose(); // another one was chosen meanwhile
    this.loading.delete("light");
    this.replace(mesh);
    this.renderer.setClearColor(new this.V.Color().setRGB(...background, "srgb"));
    if ($("lit")) $("lit").textContent = `in the light of ${name}`;
  }

  /** Show a mesh in place of the scene. @param {any} mesh */
  replace(mesh) {
    if (this.lit) {
      this.still.scene.remove(this.lit);
      this.lit.dispose();
    }
    this.lit = mesh;
    this.still.scene.add(mesh);
    this.redraw();
  }

  /** Show a file of splats in place of the scene, seen as the first photo sees it: from so far that
   * most of it is in view. @param {File} file .ply or .spz */
  async showFile(file) {
    try {
      const mesh = await droppedSplats(this.V, file), { middle, reach } = extentOf(this.V, mesh);
      const first = this.cameras[0], back = new this.V.Vector3().fromArray(first.pose, 8);
      const place = back.setLength(reach).add(middle).toArray();
      const name = `${file.name}, ${mesh.numSplats.toLocaleString("en")} Gaussians. `
        + "Load the page again to see its own scene.";
      this.cameras = [{ ...first, name, reach, near: 0, photo: "", distractors: "",
                        pose: [...first.pose.slice(0, 12), ...place, 1] }];
      this.light = -1;
      this.showFrusta(false);
      $("frusta").disabled = true;
      document.body.classList.add("dropped");
      this.replace(mesh);
      this.goTo(0);
    } catch (error) {
      alert(`${file.name} cannot be shown: ${/** @type {Error} */ (error).message}`);
    }
  }

  /** Put what was taken out of the current photo back, or away. */
  async showTaken() {
    const index = this.current, wanted = $("distractors").checked;
    const show = () => {
      for (const [other, mesh] of this.taken)
        mesh.visible = $("distractors").checked && other === this.current;
      this.redraw();
    };
    show();
    const text = this.cameras[index].distractors;
    if (wanted && text && !this.loading.has(index)) {
      this.loading.add(index);
      const spz = bytesOf(text), mesh = await newSplats(this.V, spz, await inflated(spz));
      this.front.scene.add(mesh);
      this.taken.set(index, mesh);
      show();
    }
  }

  /** The cameras of all photos as pyramids. @param {boolean} wanted */
  showFrusta(wanted) {
    if (wanted && !this.frusta) {
      this.frusta = newFrusta(this.V, this.cameras);
      this.still.scene.add(this.frusta);
    }
    if (this.frusta) this.frusta.visible = wanted;
    this.redraw();
  }

  /** Whether nothing is being loaded, sorted or drawn any more. */
  settled() {
    const busy = [this.still, this.front].some(({ spark }) => spark.sorting || spark.sortDirty);
    const idle = !busy && !this.queued && !this.loading.has("light");
    return idle && performance.now() - this.lastDraw > QUIET;
  }
}

/** Say why there is no scene, and show pictures instead. @param {string} reason */
function fail(reason) {
  $("status").textContent = reason;
  document.body.classList.replace("ready", "failed") || document.body.classList.add("failed");
}

async function start() {
  const reason = obstacle();
  if (reason) return fail(reason);
  try {
    const data = JSON.parse($("data").textContent);
    const page = new ScenePage(await loadViewer(), data);
    await page.showLight(0);
    page.goTo(0);
    const patience = new Promise(done => setTimeout(done, PATIENCE));
    await Promise.race([page.ready, patience]); // the first photo's view may show nothing
    document.body.classList.add("ready");
    Object.assign(globalThis, { scenePage: page });
  } catch (error) {
    console.error(error);
    fail(`This browser cannot draw the scene: ${/** @type {Error} */ (error).message}`);
  }
}

start();
