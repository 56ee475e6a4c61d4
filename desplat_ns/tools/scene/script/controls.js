// Mouse, fingers and keys: what moves the camera, and what the page's elements do.
// @ts-check
import { $ } from "./files.js";
import { ahead } from "./cameras.js";

const AWAKE = 600; // milliseconds for which it is drawn on after a touch
const MOUSE = 0.2, FLYING = 0.1; // degrees for each of CSS's pixels of a drag
const THUMB = 80; // degrees for a finger that crosses the stage
const TURN = 3; // degrees for each press of an arrow key, which repeats while it is held
/** What arrow keys turn: to the right, and up. @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] };

export class Controls {
  /** @param {any} V @param {any} camera @param {() => void} redraw */
  constructor(V, camera, redraw) {
    Object.assign(this, { V, camera, redraw });
    this.canvas = $("canvas");
    this.reach = 1;
    this.activeUntil = 0;
    this.fly = new V.SparkControls({ canvas: this.canvas });
    this.fly.fpsMovement.keycodeRotateMapping = {};
    this.fly.pointerControls.rotateSpeed = FLYING * Math.PI / 180;
    for (const key in ARROWS) delete this.fly.fpsMovement.keycodeMoveMapping[key];
    this.orbit = this.newOrbit(new V.Vector3(0, 0, -1));
    this.setMode(false);
    this.wakeOnTouch();
  }

  get flying() { return !this.orbit.enabled; }

  /** Turn about a point from now on, which lies in so many units. */
  aim(target, reach) {
    const { V, fly } = this, enabled = this.orbit.enabled;
    this.orbit.dispose();
    this.orbit = this.newOrbit(target);
    this.orbit.enabled = enabled;
    this.reach = reach;
    fly.fpsMovement.moveSpeed = reach / 3;
    fly.pointerControls.slideSpeed = reach / 400;
    fly.pointerControls.scrollSpeed = reach / 2000;
  }

  newOrbit(target) {
    const turn = this.camera.quaternion.clone();
    const orbit = new this.V.OrbitControls(this.camera, this.canvas); // turns it to the origin
    this.camera.quaternion.copy(turn);
    orbit.target.copy(target);
    orbit.addEventListener("change", () => this.redraw());
    return orbit;
  }

  /** Whether dragging turns the head, instead of the scene. */
  setMode(flying) {
    const { fly, V, camera } = this;
    $("mode").setAttribute("aria-pressed", String(flying));
    this.orbit.enabled = !flying;
    fly.pointerControls.enable = flying;
    fly.pointerControls.scroll.set(0, 0, 0);
    if (!flying) this.aim(ahead(V, camera, this.reach), this.reach);
    this.redraw();
  }

  /** Turn the head, or the scene in the mode for that, as dragging there does; degrees. */
  turn(right, up) {
    const { V, camera, orbit } = this;
    const sidewards = new V.Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
    const about = (axis, degrees) =>
      new V.Quaternion().setFromAxisAngle(axis, degrees * Math.PI / 180);
    const turn = about(camera.up, -right).multiply(about(sidewards, up));
    if (this.flying) camera.quaternion.premultiply(turn);
    else camera.position.sub(orbit.target).applyQuaternion(turn).add(orbit.target);
    if (!this.flying) orbit.update();
    this.redraw();
  }

  /** Walk by the keys, and turn the head in the mode for that. Whether anything moved. */
  move() {
    const { position, quaternion } = this.camera, before = position.clone(), turn = quaternion.clone();
    const moved = this.fly.update(this.camera);
    if (!moved) quaternion.copy(turn); // it rounds at rest, which is no move
    else if (this.orbit.enabled) this.orbit.target.add(position.clone().sub(before));
    return moved;
  }

  /** Whether something may be moving without telling. */
  get awake() { return performance.now() < this.activeUntil; }

  wakeOnTouch() {
    const awake = event => {
      const { clientWidth: width, clientHeight: height } = this.canvas;
      const degrees = event.pointerType === "touch" ? THUMB / width : MOUSE;
      this.orbit.rotateSpeed = degrees / 360 * height;
      this.activeUntil = performance.now() + AWAKE;
      this.redraw();
    };
    for (const kind of ["pointerdown", "pointermove", "pointerup", "wheel"])
      this.canvas.addEventListener(kind, awake, { passive: true });
    addEventListener("keydown", awake);
    // In a report, which is scrolled, the wheel and fingers are the scene's once it was clicked.
    if (parent !== globalThis) document.body.classList.add("framed");
    this.canvas.addEventListener("click", () => document.body.classList.remove("framed"));
    $("stage").addEventListener("wheel", event => {
      if (document.body.matches(".framed")) event.stopImmediatePropagation();
    }, { capture: true, passive: true });
  }
}

/** What the page's elements and keys do. @param {import("./page.js").ScenePage} page */
export function listen(page) {
  const keys = {
    n: () => page.step(1), p: () => page.step(-1),
    h: () => page.goTo(0), home: () => page.goTo(0),
    v: () => page.setMode(!page.controls.flying),
    f: () => $("full").hidden || (document.fullscreenElement
      ? document.exitFullscreen() : document.documentElement.requestFullscreen()),
    c: () => $("frusta").click(),
    "?": () => $("help").togglePopover(true),
    escape: () => { $("about").open = false; }, // browsers close the help
  };
  $("previous").onclick = keys.p;
  $("next").onclick = keys.n;
  $("home").onclick = keys.h;
  $("mode").onclick = keys.v;
  $("full").onclick = keys.f;
  $("full").hidden = !document.fullscreenEnabled;
  $("canvas").addEventListener("pointermove", event => { if (event.buttons) $("hint").hidden = true; });
  addEventListener("dragover", event => event.preventDefault());
  addEventListener("drop", event => {
    event.preventDefault();
    if (event.dataTransfer?.files.length) page.showFile(event.dataTransfer.files[0]);
  });
  $("camera").onchange = () => page.goTo(Number($("camera").value));
  $("share").oninput = () => {
    $("photo").style.clipPath = `inset(0 calc(100% - ${$("share").value}%) 0 0)`;
    page.redraw();
  };
  $("distractors").onchange = () => page.showTaken();
  $("frusta").onchange = () => page.showFrusta($("frusta").checked);
  if ($("light")) $("light").onchange = () => page.chooseLight(Number($("light").value));
  addEventListener("keydown", event => {
    const within = /** @type {Element} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    // Letters move the camera wherever one is: a list would go to a photo by its first letter.
    if (within.matches("select") && event.key.length === 1 && event.key !== " ")
      event.preventDefault();
    keys[event.key.toLowerCase()]?.();
    if (event.key in ARROWS && !within.matches("select, input"))
      page.controls.turn(...ARROWS[event.key]);
  });
}
