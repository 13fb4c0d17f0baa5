// A 3D view of a part on a tray, which turns it from aspect to aspect.
import * as THREE from 'three';
import { OrbitControls } from 'OrbitControls';

const TURN_MS = 450;
const EDGE_DEGREES = 25; // as in the pictures
const LIFT = 0.35; // hull radii, halfway through the animation
const FIELD = 38; // of view, degrees
// The direction from which the pictures are taken.
const FROM = new THREE.Vector3(0.47, -0.883, 0.727).multiplyScalar(3.0);

const still = matchMedia('(prefers-reduced-motion: reduce)');

function decoded(text, Kind) {
  return new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
}

// Fills an element with a view of a scene (see drop_page.scene). Returns `show`, which turns the
// part into the pose of a row of the scene, and `dispose`; null if the browser has no WebGL.
export function makeView(stage, data) {
  const canvas = document.createElement('canvas');
  // The same context that the renderer would create.
  const context = canvas.getContext('webgl2', { antialias: true, alpha: true });
  if (!context) return null;
  const renderer = new THREE.WebGLRenderer({ canvas, context });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  stage.append(canvas);

  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(decoded(data.points, Float32Array), 3));
  geometry.setIndex(new THREE.BufferAttribute(decoded(data.faces, Uint32Array), 1));
  const material = new THREE.MeshStandardMaterial({
    flatShading: true, roughness: 0.75, side: THREE.DoubleSide,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  const part = new THREE.Mesh(geometry, material);
  part.castShadow = part.receiveShadow = true;
  part.add(new THREE.LineSegments(
    new THREE.EdgesGeometry(geometry, EDGE_DEGREES),
    new THREE.LineBasicMaterial({ color: 0x222226 }),
  ));

  const scene = new THREE.Scene();
  const tray = new THREE.Mesh(
    new THREE.PlaneGeometry(40, 40), new THREE.ShadowMaterial({ opacity: 0.28 }),
  );
  tray.receiveShadow = true;
  const lamp = new THREE.DirectionalLight(0xffffff, 2.4);
  lamp.position.set(-2.6, -1.2, 5);
  lamp.castShadow = true;
  lamp.shadow.mapSize.set(1024, 1024);
  Object.assign(lamp.shadow.camera, { left: -3, right: 3, top: 3, bottom: -3, near: 1, far: 12 });
  lamp.shadow.normalBias = 0.02;
  scene.add(part, tray, lamp, new THREE.HemisphereLight(0xffffff, 0xb0b0b8, 1.6));

  const camera = new THREE.PerspectiveCamera(FIELD, 1, 0.05, 60);
  camera.up.set(0, 0, 1);
  camera.position.copy(FROM);
  const controls = new OrbitControls(camera, canvas);
  controls.enablePan = false;
  // The wheel scrolls the page until the user has pressed on the view.
  controls.enableZoom = false;
  canvas.addEventListener('pointerdown', () => { controls.enableZoom = true; });
  canvas.addEventListener('pointerleave', () => { controls.enableZoom = false; });
  controls.minDistance = 1.4;
  controls.maxDistance = 9;
  controls.maxPolarAngle = Math.PI / 2 - 0.03;
  // A vertical swipe of one finger scrolls the page, a horizontal one rotates the part.
  canvas.style.touchAction = 'pan-y';

  const draw = () => renderer.render(scene, camera);
  controls.addEventListener('change', draw);
  const target = new THREE.Vector3();
  function place(quaternion, height, lift = 0) {
    part.quaternion.copy(quaternion);
    part.position.z = height + lift;
    target.set(0, 0, height);
    controls.target.copy(target);
    controls.update();
    draw();
  }
  const observer = new ResizeObserver(() => {
    const { clientWidth: wide, clientHeight: high } = stage;
    if (!wide || !high) return;
    renderer.setSize(wide, high, false);
    Object.assign(canvas.style, { width: '100%', height: '100%' });
    camera.aspect = wide / high;
    // The field of view is vertical; a narrow stage needs a larger one to show the whole part.
    const half = Math.tan(FIELD * Math.PI / 360) / Math.min(camera.aspect, 1);
    camera.fov = Math.atan(half) * 360 / Math.PI;
    camera.updateProjectionMatrix();
    draw();
  });
  observer.observe(stage);

  let running = 0;
  function show(row, atOnce) {
    cancelAnimationFrame(running);
    material.color.set(row.colour);
    const from = part.quaternion.clone();
    const to = new THREE.Quaternion(...row.quaternion);
    const low = part.position.z;
    if (atOnce || still.matches) return place(to, row.height);
    const begin = performance.now();
    const step = (now) => {
      const t = Math.min(Math.max((now - begin) / TURN_MS, 0), 1);
      const s = t * t * (3 - 2 * t);
      place(from.clone().slerp(to, s), low + (row.height - low) * s, LIFT * Math.sin(Math.PI * s));
      if (t < 1) running = requestAnimationFrame(step);
    };
    running = requestAnimationFrame(step);
  }
  function dispose() {
    cancelAnimationFrame(running);
    observer.disconnect();
    controls.dispose();
    renderer.dispose();
    renderer.forceContextLoss();
    canvas.remove();
  }
  return { show, dispose };
}
