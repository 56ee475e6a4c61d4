// A scene to walk around in. Everything it needs is in the page: `data` (cameras with their photos,
// and the distractors of each), `scene` (SPZ), `wasm` and `viewer` (libraries, compressed).
"use strict";

/** @typedef {{name: string, heldOut: boolean, size: [number, number], near: number, reach: number,
 *   lens: [number, number, number, number], pose: number[], photo: string, distractors: string}}
 *   PhotoCamera  sizes and lens (fx, fy, cx, cy) in pixels, the pose by columns */

const FAR = 1e4, NEAREST = 0.01;
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
/** Away from a photo's camera, in shares of its reach or of 45 degrees: what belongs to it alone is
 * whole up to the first and gone from the second. */
const WHOLE = 0.02, GONE = 0.2;
/** The near plane of a photo's camera holds up to the first, and none is left from the second. */
const NEAR_WHOLE = 0.1, NEAR_GONE = 0.5;
const PATIENCE = 60_000; // milliseconds until the first picture
const WHY_FADING = "What was taken out was made for this view alone: nobody knows how it looks from "
  + "elsewhere, so it fades as you leave.";

/** @param {string} id @returns {any} */
const $ = id => document.getElementById(id);
const bytesOf = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
const embedded = id => bytesOf($(id).textContent);
/** 1 up to `from`, 0 beyond `to`. */
const falling = (x, from, to) => Math.min(1, Math.max(0, (to - x) / (to - from)));

/** @param {Uint8Array} bytes of a gzip file @returns {Promise<Uint8Array>} */
async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Run the libraries: they leave a global `Viewer`. */
async function loadViewer() {
  globalThis.SPARK_WASM = await inflated(embedded("wasm"));
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await inflated(embedded("viewer")))
    + "\nglobalThis.Viewer = Viewer;";
  document.head.append(script);
  return globalThis.Viewer;
}

/** Why this browser cannot draw the scene; empty if it can. */
function obstacle() {
  if (!document.createElement("canvas").getContext("webgl2"))
    return "This browser cannot draw the scene: it has no WebGL 2, or it is switched off.";
  if (!globalThis.DecompressionStream || !globalThis.WebAssembly)
    return "This browser is too old to draw the scene.";
  return "";
}

function fail(reason) {
  $("status").textContent = reason;
  document.body.classList.replace("ready", "failed") || document.body.classList.add("failed");
}

class ScenePage {
  constructor(V, data) {
    this.V = V;
    /** @type {PhotoCamera[]} */
    this.cameras = data.cameras;
    this.antialiased = data.antialiased;
    V.ColorManagement.workingColorSpace = "srgb";  // Gaussians are blended as they were trained
    this.renderer = new V.WebGLRenderer({ canvas: $("canvas"), antialias: false });
    this.renderer.autoClear = false;
    this.renderer.setClearColor(new V.Color().setRGB(...data.background, "srgb"));
    this.camera = new V.PerspectiveCamera();
    this.camera.matrixAutoUpdate = true;
    // Two scenes, so that what was taken out lies in front, whatever its depth, as in training.
    this.canvas = this.newTarget();
    this.still = this.newLayer();
    this.front = this.newLayer();
    this.frusta = null;
    this.taken = new Map();
    this.loading = new Set();
    this.current = 0;
    this.queued = false;
    this.activeUntil = 0;
    this.lastDraw = 0;
    this.ready = new Promise(done => { this.isReady = done; });
    this.setUpControls();
    new ResizeObserver(() => this.resize()).observe($("stage"));
  }

  /** What is drawn on, and how it comes to the screen. Hundreds of faint Gaussians over one another
   * would be rounded to 8 bits one after the other; where the graphics can, it is done in 16. */
  newTarget() {
    const { V, renderer: { extensions } } = this;
    const fine = ["EXT_color_buffer_float", "EXT_color_buffer_half_float"];
    if (!fine.some(name => extensions.has(name))) return null;
    const target = new V.WebGLRenderTarget(1, 1, { type: V.HalfFloatType });
    const quad = new V.FullScreenQuad(new V.ShaderMaterial({
      uniforms: { drawn: { value: target.texture } }, depthTest: false, depthWrite: false,
      vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position, 1.0); }",
      fragmentShader: "uniform sampler2D drawn; varying vec2 at;"
        + " void main() { gl_FragColor = vec4(texture2D(drawn, at).rgb, 1.0); }",
    }));
    return { target, quad };
  }

  newLayer() {
    const scene = new this.V.Scene();
    const spark = new this.V.SparkRenderer({
      renderer: this.renderer, onDirty: () => this.redraw(),
      maxStdDev: REACH_SIGMAS, minAlpha: 1 / 255, maxPixelRadius: 4096, clipXY: BESIDE,
      // the EWA filter of training; with antialiasing it takes opacity in exchange
      preBlurAmount: this.antialiased ? 0 : 0.3, blurAmount: this.antialiased ? 0.3 : 0,
      sortRadial: false, enableLod: false, accumExtSplats: true,
    });
    const { material } = spark, shader = material.vertexShader;
    material.vertexShader = shader.replace(SPARKS_JACOBIAN, CLAMPED_JACOBIAN);
    if (material.vertexShader === shader) throw new Error("Spark's shader is another one");
    scene.add(spark);
    return { scene, spark };
  }

  /** @param {Uint8Array} spz */
  async addSplats(layer, spz) {
    const mesh = new this.V.SplatMesh({ fileBytes: spz, fileType: "spz", extSplats: true });
    await mesh.initialized;
    layer.scene.add(mesh);
    return mesh;
  }

  // --- cameras -------------------------------------------------------------------------------

  /** Go to a photo's camera. */
  goTo(index) {
    const { V, camera } = this, one = this.cameras[index];
    this.current = index;
    const pose = new V.Matrix4().fromArray(one.pose), forward = new V.Vector3(0, 0, -1);
    const right = new V.Vector3().setFromMatrixColumn(pose, 0);
    const up = new V.Vector3().setFromMatrixColumn(pose, 1);
    // Turning is about the vertical, unless the photo was taken sidewards or straight down.
    const upright = Math.abs(right.y) < 0.5 && up.y > 0.1;
    camera.up.copy(upright ? new V.Vector3(0, 1, 0) : up);
    camera.position.setFromMatrixPosition(pose);
    camera.quaternion.setFromRotationMatrix(pose);
    const target = forward.applyQuaternion(camera.quaternion).multiplyScalar(one.reach);
    this.aim(target.add(camera.position));
    camera.quaternion.setFromRotationMatrix(pose);
    this.fly.fpsMovement.moveSpeed = one.reach / 3;
    this.fly.pointerControls.slideSpeed = one.reach / 400;
    this.fly.pointerControls.scrollSpeed = one.reach / 2000;
    $("photo").src = one.photo;
    $("photo").alt = `The photo ${one.name}`;
    $("camera").value = String(index);
    $("distractors").disabled = !one.distractors;
    this.showTaken();
    this.resize();
  }

  /** Turn about a point from now on. */
  aim(target) {
    const { V } = this, enabled = !this.orbit || this.orbit.enabled;
    this.orbit?.dispose();
    this.orbit = new V.OrbitControls(this.camera, $("canvas"));
    this.orbit.enabled = enabled;
    this.orbit.target.copy(target);
    this.orbit.addEventListener("change", () => this.redraw());
  }

  /** How far the camera is from a photo's: in reaches, or in units of 45 degrees. */
  away(index) {
    const { V, camera } = this, one = this.cameras[index];
    const pose = new V.Matrix4().fromArray(one.pose);
    const place = new V.Vector3().setFromMatrixPosition(pose);
    const turn = new V.Quaternion().setFromRotationMatrix(pose);
    const angle = camera.quaternion.angleTo(turn) / (Math.PI / 4);
    return Math.max(camera.position.distanceTo(place) / one.reach, angle);
  }

  /** The near plane where the camera is: that of the nearest photo's, less away from it, so that
   * one can walk up to a wall. */
  near() {
    const { V, camera } = this;
    const distance = one => camera.position.distanceTo(
      new V.Vector3().fromArray(one.pose, 12)) / one.reach;
    const nearest = this.cameras.reduce((a, b) => distance(b) < distance(a) ? b : a);
    return Math.max(NEAREST, nearest.near * falling(distance(nearest), NEAR_WHOLE, NEAR_GONE));
  }

  /** Where the photo of the current camera lies on the stage, in CSS pixels. */
  frame() {
    const [width, height] = this.cameras[this.current].size, stage = $("stage");
    const scale = Math.min(stage.clientWidth / width, stage.clientHeight / height);
    return { scale, left: (stage.clientWidth - width * scale) / 2,
             top: (stage.clientHeight - height * scale) / 2,
             width: width * scale, height: height * scale };
  }

  /** The current photo's lens, on the whole stage. */
  setLens(near) {
    const { camera } = this, [fx, fy, cx, cy] = this.cameras[this.current].lens;
    const { clientWidth: width, clientHeight: height } = $("stage"), at = this.frame();
    const x = 1 - 2 * (at.left + at.scale * cx) / width;
    const y = 2 * (at.top + at.scale * cy) / height - 1;
    camera.projectionMatrix.set(
      2 * fx * at.scale / width, 0, x, 0,
      0, 2 * fy * at.scale / height, y, 0,
      0, 0, -(FAR + near) / (FAR - near), -2 * FAR * near / (FAR - near),
      0, 0, -1, 0);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    camera.near = near;
    camera.far = FAR;
    camera.aspect = width / height;
    camera.fov = 360 / Math.PI * Math.atan(height / 2 / (fy * at.scale));
  }

  resize() {
    const stage = $("stage"), at = this.frame();
    if (!stage.clientWidth || !stage.clientHeight) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
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
    const moved = this.move(), { camera, renderer, still, front } = this;
    this.lastDraw = performance.now();
    camera.updateMatrixWorld();
    renderer.setRenderTarget(this.canvas?.target ?? null);
    renderer.clear();
    this.setLens(this.near());
    renderer.render(still.scene, camera);
    const away = this.away(this.current), whole = falling(away, WHOLE, GONE);
    const mesh = this.taken.get(this.current);
    if (mesh?.visible && whole > 0) {
      mesh.opacity = whole;
      this.setLens(NEAREST);
      renderer.render(front.scene, camera);
    }
    renderer.setRenderTarget(null);
    this.canvas?.quad.render(renderer);
    $("photo").style.opacity = falling(away, 0.005, WHOLE);
    $("photo").hidden = $("share").value === "0";
    this.tell(whole);
    if (moved || performance.now() < this.activeUntil) this.redraw();
    if (still.spark.activeSplats > 0) this.isReady();
  }

  tell(whole) {
    const one = this.cameras[this.current], kind = one.heldOut ? "held-out" : "training photo";
    const place = this.away(this.current) < WHOLE ? `At ${one.name} (${kind}).`
      : `Away from ${one.name}.`;
    const fading = $("distractors").checked && one.distractors ? ` ${WHY_FADING}` : "";
    const text = place + fading;
    if ($("note").textContent !== text) $("note").textContent = text;
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
      this.taken.set(index, await this.addSplats(this.front, bytesOf(text)));
      show();
    }
  }

  /** The cameras of all photos as pyramids. */
  showFrusta(wanted) {
    const { V } = this;
    if (wanted && !this.frusta) {
      const places = [], colors = [], size = 0.08 * this.cameras[0].reach;
      for (const one of this.cameras) {
        const [fx, fy, cx, cy] = one.lens, [width, height] = one.size;
        const pose = new V.Matrix4().fromArray(one.pose);
        const corner = (u, v) => new V.Vector3((u - cx) / fx, (cy - v) / fy, -1)
          .multiplyScalar(size).applyMatrix4(pose);
        const ring = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
        const tip = new V.Vector3().setFromMatrixPosition(pose);
        const color = new V.Color(one.heldOut ? "#f0985a" : "#5bb8e0");
        ring.forEach((point, i) => {
          places.push(...tip, ...point, ...point, ...ring[(i + 1) % 4]);
          for (let k = 0; k < 4; k++) colors.push(...color);
        });
      }
      const geometry = new V.BufferGeometry();
      geometry.setAttribute("position", new V.Float32BufferAttribute(places, 3));
      geometry.setAttribute("color", new V.Float32BufferAttribute(colors, 3));
      this.frusta = new V.LineSegments(geometry, new V.LineBasicMaterial({ vertexColors: true }));
      this.frusta.frustumCulled = false;
      this.still.scene.add(this.frusta);
    }
    if (this.frusta) this.frusta.visible = wanted;
    this.redraw();
  }

  // --- controls ------------------------------------------------------------------------------

  /** Walk by the keys, and turn the head in the mode for that. Whether anything moved. */
  move() {
    const before = this.camera.position.clone();
    const typing = document.activeElement?.matches("select, input");
    this.fly.fpsMovement.enable = !typing;
    const moved = this.fly.update(this.camera);
    if (moved && this.orbit.enabled)
      this.orbit.target.add(this.camera.position.clone().sub(before));
    return moved;
  }

  setMode(flying) {
    const { V, camera, fly } = this;
    $("mode").setAttribute("aria-pressed", String(flying));
    this.orbit.enabled = !flying;
    fly.pointerControls.enable = flying;
    fly.pointerControls.scroll.set(0, 0, 0);
    fly.fpsMovement.keycodeRotateMapping = flying ? this.turningKeys : {};
    if (!flying) {
      const ahead = new V.Vector3(0, 0, -this.cameras[this.current].reach);
      this.aim(ahead.applyQuaternion(camera.quaternion).add(camera.position));
    }
    this.redraw();
  }

  step(by) {
    const count = this.cameras.length;
    this.goTo((this.current + by + count) % count);
  }

  setUpControls() {
    const canvas = $("canvas"), toggle = id => { $(id).checked = !$(id).checked; };
    this.fly = new this.V.SparkControls({ canvas });
    this.turningKeys = this.fly.fpsMovement.keycodeRotateMapping;
    this.aim(new this.V.Vector3(0, 0, -1));
    this.setMode(false);
    // In a report, which is scrolled, the wheel and fingers are the scene's once it was clicked.
    if (parent !== globalThis) document.body.classList.add("framed");
    canvas.addEventListener("click", () => document.body.classList.remove("framed"));
    $("stage").addEventListener("wheel", event => {
      if (document.body.matches(".framed")) event.stopImmediatePropagation();
    }, { capture: true, passive: true });
    const awake = () => { this.activeUntil = performance.now() + 600; this.redraw(); };
    for (const kind of ["pointerdown", "pointermove", "pointerup", "wheel"])
      canvas.addEventListener(kind, awake, { passive: true });
    addEventListener("keydown", awake);
    $("previous").onclick = () => this.step(-1);
    $("next").onclick = () => this.step(1);
    $("camera").onchange = () => this.goTo(Number($("camera").value));
    $("share").oninput = () => {
      $("photo").style.clipPath = `inset(0 calc(100% - ${$("share").value}%) 0 0)`;
      this.redraw();
    };
    $("distractors").onchange = () => this.showTaken();
    $("frusta").onchange = () => this.showFrusta($("frusta").checked);
    $("mode").onclick = () => this.setMode(this.orbit.enabled);
    addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
      const key = event.key.toLowerCase();
      if (key === "n") this.step(1);
      if (key === "p") this.step(-1);
      if (key === "f") this.setMode(this.orbit.enabled);
      if (key === "c") { toggle("frusta"); this.showFrusta($("frusta").checked); }
    });
    canvas.addEventListener("webglcontextlost", () =>
      fail("The browser took the graphics away from this page. Load it again."));
  }

  /** Whether nothing is being sorted or drawn any more. */
  settled() {
    const busy = [this.still, this.front].some(({ spark }) => spark.sorting || spark.sortDirty);
    return !busy && !this.queued && performance.now() - this.lastDraw > 200;
  }
}

async function start() {
  const reason = obstacle();
  if (reason) return fail(reason);
  try {
    const data = JSON.parse($("data").textContent);
    const page = new ScenePage(await loadViewer(), data);
    await page.addSplats(page.still, embedded("scene"));
    page.goTo(0);
    const patience = new Promise(done => setTimeout(done, PATIENCE));
    await Promise.race([page.ready, patience]); // the first photo's view may show nothing
    page.firstPicture = performance.now();
    document.body.classList.add("ready");
    globalThis.scenePage = page;
  } catch (error) {
    console.error(error);
    fail(`This browser cannot draw the scene: ${error.message}`);
  }
}

start();
