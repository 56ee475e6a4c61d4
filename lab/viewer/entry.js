// What the page of a scene takes from the libraries; all else is left out of the bundle.
export { SparkControls, SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
export {
  BufferGeometry, Color, ColorManagement, Float32BufferAttribute, HalfFloatType, LineBasicMaterial,
  LineSegments, Matrix4, PerspectiveCamera, Quaternion, Scene, ShaderMaterial, Vector3,
  WebGLRenderer, WebGLRenderTarget,
} from "three";
export { FullScreenQuad } from "three/examples/jsm/postprocessing/Pass.js";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
