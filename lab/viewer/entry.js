// What the page of a scene takes from the libraries; all else is left out of the bundle.
export { SparkControls, SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
export {
  BufferGeometry, Color, Float32BufferAttribute, LineBasicMaterial, LineSegments, Matrix4,
  PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
