// The part of the judge vrma.mjs that runs in the browser: a player of VRM animations, as people write one with three-vrm.

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { VRMLoaderPlugin, VRMUtils } from "@pixiv/three-vrm";
import { VRMAnimationLoaderPlugin, VRMLookAtQuaternionProxy, createVRMAnimationClip } from "@pixiv/three-vrm-animation";

const loader = new GLTFLoader();
loader.register((parser) => new VRMLoaderPlugin(parser));
loader.register((parser) => new VRMAnimationLoaderPlugin(parser));

/** The bones whose directions are compared, each with the bone at its end. */
const BONES = [
  ["spine", "chest"], ["chest", "upperChest"], ["upperChest", "neck"], ["neck", "head"],
  ...["left", "right"].flatMap((side) => [
    ["Shoulder", "UpperArm"], ["UpperArm", "LowerArm"], ["LowerArm", "Hand"],
    ["UpperLeg", "LowerLeg"], ["LowerLeg", "Foot"], ["Foot", "Toes"],
  ].map((bones) => bones.map((bone) => side + bone))),
];

/** Loads a character and an animation, and starts to play. */
async function load(names) {
  const [{ userData: { vrm } }, { userData: { vrmAnimations } }] =
    await Promise.all([loader.loadAsync(`./files/${names.character}`), loader.loadAsync(`./files/${names.animation}`)]);
  VRMUtils.rotateVRM0(vrm);
  if (vrm.lookAt) {
    const proxy = new VRMLookAtQuaternionProxy(vrm.lookAt);
    proxy.name = "lookAtQuaternionProxy";
    vrm.scene.add(proxy);
  }
  vrm.scene.updateMatrixWorld(true);
  const clip = createVRMAnimationClip(vrmAnimations[0], vrm);
  const mixer = new THREE.AnimationMixer(vrm.scene);
  const seek = (time) => {
    mixer.setTime(time);
    vrm.update(0);
    vrm.scene.updateMatrixWorld(true);
  };
  return { vrm, clip, seek, play: () => mixer.clipAction(clip).setLoop(THREE.LoopOnce).play().clampWhenFinished = true };
}

/** The places and rotations of a character's own bones in the world. */
function pose(vrm) {
  const place = {}, rotation = {};
  for (const bone of Object.keys(vrm.humanoid.humanBones)) {
    const node = vrm.humanoid.getRawBoneNode(bone);
    place[bone] = node.getWorldPosition(new THREE.Vector3());
    rotation[bone] = node.getWorldQuaternion(new THREE.Quaternion());
  }
  const direction = (from, to) => new THREE.Vector3().subVectors(place[to], place[from]).normalize();
  return { place, rotation, direction };
}

/** Plays an animation on a character, and measures how far the bones are from what the motion says. */
window.play = async (names, expected) => {
  const { vrm, clip, seek, play } = await load(names);
  const rest = pose(vrm);
  const left = rest.direction("rightUpperLeg", "leftUpperLeg");
  play();
  const worst = () => ({ most: 0, count: 0 });
  const found = {
    version: vrm.meta.metaVersion,
    // The body's left side is at +X where it faces +Z with Y up.
    faces: left.x,
    duration: clip.duration,
    directions: worst(), rotations: worst(), hips: worst(),
  };
  const note = (record, value, bone, time) => {
    record.count += 1;
    if (!(value <= record.most)) Object.assign(record, { most: value, bone, time });
  };
  for (const frame of expected.frames) {
    seek(frame.time);
    const now = pose(vrm);
    const turns = Object.fromEntries(
      Object.entries(frame.rotations).map(([bone, turn]) => [bone, new THREE.Quaternion(...turn)]));
    for (const [from, to] of BONES) {
      if (!now.place[from] || !now.place[to]) continue;
      // The motion turns the bone from its own rest pose.
      const wanted = rest.direction(from, to).applyQuaternion(turns[from]);
      const angle = THREE.MathUtils.radToDeg(now.direction(from, to).angleTo(wanted));
      note(found.directions, angle, from, frame.time);
    }
    for (const [bone, turn] of Object.entries(turns)) {
      // How far the spine twists with the chest is the file's own choice.
      if (!now.rotation[bone] || bone === "spine") continue;
      const played = now.rotation[bone].clone().multiply(rest.rotation[bone].clone().invert());
      note(found.rotations, THREE.MathUtils.radToDeg(played.angleTo(turn)), bone, frame.time);
    }
    const size = rest.place.hips.y / expected.rest_hips_height;
    const wanted = new THREE.Vector3(...frame.hips).multiplyScalar(size);
    note(found.hips, 1000 * wanted.distanceTo(now.place.hips), "hips", frame.time);
  }
  return found;
};

let renderer;
/** Draws a character at six times of an animation side by side. Returns why, if it cannot. */
window.draw = async (names) => {
  try {
    renderer ??= new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    return String(error);
  }
  const { vrm, clip, seek, play } = await load(names);
  play();
  const [width, height, count] = [innerWidth, innerHeight, 6];
  renderer.setSize(width, height);
  renderer.setScissorTest(true);
  renderer.autoClear = false;
  document.body.append(renderer.domElement);
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf3f4f6);
  const sun = new THREE.DirectionalLight(0xffffff, 1.5);
  sun.position.set(2, 4, 3);
  scene.add(vrm.scene, sun, new THREE.HemisphereLight(0xffffff, 0x888888, 1.6), new THREE.GridHelper(20, 40, 0x888888, 0xbbbbbb));
  vrm.scene.traverse((object) => { object.frustumCulled = false; });
  const size = vrm.humanoid.getRawBoneNode("hips").getWorldPosition(new THREE.Vector3()).y;
  for (let index = 0; index < count; index++) {
    seek((clip.duration * index) / (count - 1));
    const hips = vrm.humanoid.getRawBoneNode("hips").getWorldPosition(new THREE.Vector3());
    const camera = new THREE.PerspectiveCamera(35, width / count / height, 0.05, 100);
    camera.position.set(hips.x + 2.4 * size, 1.4 * size, hips.z + 4.2 * size);
    camera.lookAt(hips.x, 0.9 * size, hips.z);
    const area = [(index * width) / count, 0, width / count, height];
    renderer.setViewport(...area);
    renderer.setScissor(...area);
    renderer.render(scene, camera);
  }
  return null;
};
