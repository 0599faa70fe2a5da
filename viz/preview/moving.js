"use strict";
// The page of a run with one instant, which is replaced by every frame that the server sends.
viewer.animator.seek = () => {};  // there is nothing but now
for (const id of ["play", "slider", "speed"]) $(id).style.display = "none";
document.title = "live: " + document.title;
// the first pose alone says where to look from: farther off there is room to move
const ROOM = 1.7;
data.home.eye = data.home.eye.map((x, i) => data.home.target[i] + ROOM * (x - data.home.target[i]));
if (view < 0) look(view);
$("charts").style.display = "none";  // of one instant there is no curve, but every angle now
$("list").style.flex = "1";
for (const joint of data.joints) joint.box.style.display = "none";

function pose(name, joints) {
  for (const [joint, place] of Object.entries(joints)) {
    const moved = node(name, joint);
    moved.position.fromArray(place, 0);
    moved.quaternion.fromArray(place, 3);
  }
}
function show(frame, images) {
  data.index[0] = frame.index;
  data.time[0] = frame.time;
  data.status[0] = frame.status;
  data.best[0] = frame.best;
  data.weight[0] = frame.weight;
  frame.angles.forEach((angle, i) => { data.joints[i].value[0] = angle; });
  pose("body", frame.body);
  frame.hypotheses.forEach((joints, k) => pose("hypothesis_" + k, joints));
  images.forEach((image, c) => {
    const camera = data.cameras[c], before = camera.textures[0];
    if (!image || !camera.material) return;
    camera.textures[0] = new MeshCat.THREE.Texture(image);
    camera.textures[0].needsUpdate = true;
    if (before) before.dispose();
  });
  apply();
  if (frame.best >= 0) bars[frame.best].number.textContent = percent(frame.weight[frame.best]) + " \u25c0 drawn";
  $("clock").append("  " + frame.note);
}
// body and picture change together: a frame is shown when its pictures are decoded, unless a later one was by then
let shownLast = -1;
async function take(frame) {
  const images = await Promise.all(frame.pictures.map(async address => {
    if (!address) return null;
    const image = new Image();
    image.src = address;
    await image.decode();
    return image;
  }));
  if (frame.index <= shownLast) return;
  shownLast = frame.index;
  show(frame, images);
}
const stream = new EventSource("frames");
stream.onmessage = event => take(JSON.parse(event.data));
stream.addEventListener("end", event => { stream.close(); $("clock").append("  " + event.data); });
