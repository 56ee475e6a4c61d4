// The cameras of all photos as pyramids of lines.
// @ts-check
import { poseOf } from "./cameras.js";

const TRAINING = "#5bb8e0", HELD_OUT = "#f0985a";
const SIZE = 0.08; // of the first photo's reach

/** @param {any} V the library @param {import("./cameras.js").PhotoCamera[]} cameras */
export function newFrusta(V, cameras) {
  const places = [], colors = [], size = SIZE * cameras[0].reach;
  for (const one of cameras) {
    const [fx, fy, cx, cy] = one.lens, [width, height] = one.size;
    const { matrix, place: tip } = poseOf(V, one);
    /** @param {number} u @param {number} v */
    const corner = (u, v) => new V.Vector3((u - cx) / fx, (cy - v) / fy, -1)
      .multiplyScalar(size).applyMatrix4(matrix);
    const ring = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
    const color = new V.Color(one.heldOut ? HELD_OUT : TRAINING);
    for (const [i, point] of ring.entries()) {
      places.push(...tip, ...point, ...point, ...ring[(i + 1) % 4]);
      for (let k = 0; k < 4; k++) colors.push(...color);
    }
  }
  const geometry = new V.BufferGeometry();
  geometry.setAttribute("position", new V.Float32BufferAttribute(places, 3));
  geometry.setAttribute("color", new V.Float32BufferAttribute(colors, 3));
  const frusta = new V.LineSegments(geometry, new V.LineBasicMaterial({ vertexColors: true }));
  frusta.frustumCulled = false;
  return frusta;
}
