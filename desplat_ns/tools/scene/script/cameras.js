// Where photos were taken, and what their lenses show. `V` is the library, `camera` three's.
// @ts-check

/** @typedef {{index: number, name: string, heldOut: boolean, size: [number, number], near: number,
 *   lens: [number, number, number, number], reach: number, pose: number[], photo: string,
 *   distractors: string}} PhotoCamera
 *   size and lens (fx, fy, cx, cy) in pixels; the pose, camera to world, by columns; near plane and
 *   reach (the median depth of what is seen) in world units */
/** @typedef {{scale: number, left: number, top: number, width: number, height: number}} Frame
 *   where a photo lies on the stage, in CSS pixels */

const FAR = 1e4;
export const NEAREST = 0.01; // near plane where a photo asks for none
/** Away from a photo's camera, in shares of its reach or of 45 degrees: what belongs to it alone is
 * whole up to the first and gone from the second. */
export const WHOLE = 0.02, GONE = 0.2;
/** The near plane of a photo's camera holds up to the first, and none is left from the second. */
const NEAR_WHOLE = 0.1, NEAR_GONE = 0.5;

/** 1 up to `from`, 0 beyond `to`. @type {(x: number, from: number, to: number) => number} */
export const falling = (x, from, to) => Math.min(1, Math.max(0, (to - x) / (to - from)));

/** Place and turn of a photo's camera. @param {any} V @param {PhotoCamera} one */
export function poseOf(V, one) {
  const matrix = new V.Matrix4().fromArray(one.pose);
  return { matrix, place: new V.Vector3().setFromMatrixPosition(matrix),
           turn: new V.Quaternion().setFromRotationMatrix(matrix) };
}

/** Put the camera where a photo's was; the point that lies in its middle.
 * @param {any} V @param {any} camera @param {PhotoCamera} one */
export function standAt(V, camera, one) {
  const { matrix, place, turn } = poseOf(V, one);
  const right = new V.Vector3().setFromMatrixColumn(matrix, 0);
  const up = new V.Vector3().setFromMatrixColumn(matrix, 1);
  // Turning is about the vertical, unless the photo was taken sidewards or straight down.
  const upright = Math.abs(right.y) < 0.5 && up.y > 0.1;
  camera.up.copy(upright ? new V.Vector3(0, 1, 0) : up);
  camera.position.copy(place);
  camera.quaternion.copy(turn);
  return ahead(V, camera, one.reach);
}

/** The point so far before the camera. @param {any} V @param {any} camera @param {number} far */
export const ahead = (V, camera, far) =>
  new V.Vector3(0, 0, -far).applyQuaternion(camera.quaternion).add(camera.position);

/** How far the camera is from a photo's: in its reaches, or in units of 45 degrees.
 * @param {any} V @param {any} camera @param {PhotoCamera} one @returns {number} */
export function away(V, camera, one) {
  const { place, turn } = poseOf(V, one);
  const angle = camera.quaternion.angleTo(turn) / (Math.PI / 4);
  return Math.max(camera.position.distanceTo(place) / one.reach, angle);
}

/** The near plane where the camera is: that of the nearest photo's, less away from it, so that one
 * can walk up to a wall.
 * @param {any} V @param {any} camera @param {PhotoCamera[]} photos @returns {number} */
export function nearPlane(V, camera, photos) {
  /** @param {PhotoCamera} one */
  const distance = one => camera.position.distanceTo(poseOf(V, one).place) / one.reach;
  const nearest = photos.reduce((a, b) => distance(b) < distance(a) ? b : a);
  return Math.max(NEAREST, nearest.near * falling(distance(nearest), NEAR_WHOLE, NEAR_GONE));
}

/** Where a photo lies on the stage. @param {PhotoCamera} one @param {HTMLElement} stage
 * @returns {Frame} */
export function frameOf(one, stage) {
  const [width, height] = one.size;
  const scale = Math.min(stage.clientWidth / width, stage.clientHeight / height);
  return { scale, left: (stage.clientWidth - width * scale) / 2,
           top: (stage.clientHeight - height * scale) / 2,
           width: width * scale, height: height * scale };
}

/** Give the camera a photo's lens, on the whole stage.
 * @param {any} camera @param {PhotoCamera} one @param {HTMLElement} stage @param {number} near */
export function setLens(camera, one, stage, near) {
  const [fx, fy, cx, cy] = one.lens, at = frameOf(one, stage);
  const { clientWidth: width, clientHeight: height } = stage;
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
