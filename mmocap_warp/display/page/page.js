const content = JSON.parse(document.getElementById("content").textContent);
const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((made) => [made.id, made]));
const { body, cameras, frames, fps } = content;
const joints = new Float32Array(8 * body.joints.length);
const pinholes = cameras.map((camera) => Pinhole.of(camera));
const seconds = frames.map((number) => (number - frames[0]) / fps);
const last = frames.length - 1;
const tracks = content.runs.map((run) => Object.fromEntries(
  Object.entries(run.tracks).map(([name, motion]) => [name, new Track(motion, body.joints.length)])));
const overlaps = content.runs.map((run) => unpack(run.iou));
const state = { position: 0, playing: false, run: content.best, through: null };
let curves = [];

// What is shown: a frame, or a place between two while it plays.
const trackName = () => (part.raw.checked && tracks[state.run].raw ? "raw" : "final");
const track = () => tracks[state.run][trackName()];
const frame = () => Math.min(Math.round(state.position), last);

function seek(position) {
  state.position = Math.min(Math.max(position, 0), last);
  refresh();
}

function play(playing) {
  if (playing && state.position >= last) state.position = 0;
  if (!playing) state.position = frame();
  state.playing = playing;
  part.play.textContent = playing ? "Pause" : "Play";
  part.play.setAttribute("aria-pressed", String(playing));
  refresh();
}

function advance(elapsed) {
  const now = Math.floor(state.position);
  const rest = state.position - now;
  const span = (i) => seconds[Math.min(i + 1, last)] - seconds[Math.min(i, last)];
  const time = seconds[now] + rest * span(now) + elapsed * Number(part.speed.value);
  if (time >= seconds[last]) {
    state.position = 0; // and again
    return;
  }
  let i = now;
  while (i < last - 1 && seconds[i + 1] <= time) i++;
  state.position = i + (time - seconds[i]) / span(i);
}

function chooseRun(run) {
  state.run = run;
  const odd = content.runs[run].status.flatMap((status, i) => (status === 0 ? [] : [i]));
  curves = content.runs[run].curves.map((curve) => new Curve(curve, odd, (i) => { play(false); seek(i); }));
  part.curves.replaceChildren(...curves.map((curve) => curve.figure));
  part.unsmoothed.hidden = !tracks[run].raw;
  refresh();
}

function lookThrough(k) {
  state.through = k !== null && k < cameras.length && k !== state.through ? k : null;
  part.free.hidden = state.through === null;
  tiles.forEach((tile, i) => tile.button.setAttribute("aria-pressed", String(i === state.through)));
  refresh();
}

// Each camera's small picture, which is also drawn in the world.
class Tile {
  constructor(camera, k) {
    this.camera = camera;
    this.textures = {};
    this.shown = {};
    this.pictures = {};
    const seen = element("span", { className: "seen" });
    seen.style.aspectRatio = camera.size.join("/");
    const withImages = camera.images.some(Boolean);
    for (const kind of ["images", "masks"]) {
      if (!camera[kind].some(Boolean)) continue;
      const picture = element("img", { alt: "", className: kind === "masks" && withImages ? "over" : "" });
      picture.addEventListener("load", () => {
        if (stage) this.textures[kind] = stage.loadPicture(picture, this.textures[kind]);
        refresh();
      });
      this.pictures[kind] = picture;
      seen.append(picture);
    }
    this.overlap = element("span");
    this.age = element("span", { className: "age" });
    seen.append(this.age);
    const name = element("span", { textContent: `${k + 1} ${camera.name}`, title: camera.name });
    this.button = element("button", { type: "button" }, [
      ...(Object.keys(this.pictures).length ? [seen] : []), element("span", { className: "words" }, [name, this.overlap]),
    ]);
    this.button.setAttribute("aria-pressed", "false");
    this.button.addEventListener("click", () => lookThrough(k));
  }

  show(i, overlap, keep) {
    for (const [kind, picture] of Object.entries(keep ? {} : this.pictures)) {
      const number = Math.floor(i / content.every[kind]);
      if (this.shown[kind] === number) continue;
      this.shown[kind] = number;
      const data = this.camera[kind][number];
      picture.hidden = !data;
      if (data) picture.src = `data:image/${kind === "masks" ? "png" : "jpeg"};base64,${data}`;
      else delete this.textures[kind];
    }
    const old = Object.entries(this.shown).filter(([kind, number]) => number * content.every[kind] !== i);
    this.age.textContent = old.map(([kind, number]) => `${kind.slice(0, -1)} of frame ${frames[number * content.every[kind]]}`).join(", ");
    this.overlap.textContent = Number.isFinite(overlap) ? `IoU ${overlap.toFixed(3)}` : "no mask";
  }
}

// Colours follow the page's, light or dark.
let colours;
function readColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["plate", "grid", "skin", "left", "right", "middle", "mask", "soft", "accent"];
  colours = Object.fromEntries(names.map((name) => {
    const hex = style.getPropertyValue(`--${name}`).trim();
    return [name, [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255)];
  }));
  refresh();
}

let orbit;
function placeView() {
  const [low, high] = track().extent();
  const middle = add(low, high).map((value) => value / 2);
  const radius = Math.max(Math.hypot(...add(high, low, -1)) / 2, 0.1);
  const front = turning(track().at(0, joints)).map((row) => row[2]); // where the body's +Z points in the first frame
  orbit = new Orbit(middle, 3.8 * radius, content.up, front);
  orbit.reach = radius;
}

const camerasReach = () => Math.max(...pinholes.map((pinhole) => Math.hypot(...add(pinhole.eye, orbit.target, -1))));

function gridLines() {
  const up = content.up.map(Math.abs);
  const [a, b] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].filter((axis) => dot(axis, up) < 0.5);
  const middle = add(a.map((v) => v * Math.round(dot(orbit.target, a))), b, Math.round(dot(orbit.target, b)));
  const half = Math.min(Math.max(Math.ceil(orbit.reach) + 2, 4), 30);
  const lines = [];
  for (let i = -half; i <= half; i++) {
    for (const [along, across] of [[a, b], [b, a]]) {
      const at = add(middle, across, i);
      lines.push([...add(at, along, -half), ...add(at, along, half), ...colours.grid, 1, 1.2]);
    }
  }
  return lines;
}

function skeletonLines() {
  const place = (j) => [...joints.subarray(8 * j + 4, 8 * j + 7)];
  return body.parent.flatMap((parent, j) =>
    parent < 0 ? [] : [[...place(parent), ...place(j), ...colours[body.side[j]], 1, 3]]);
}

function cameraLines(corners, eye, chosen) {
  const line = (from, to) => [...from, ...to, ...(chosen ? colours.accent : colours.soft), 1, 1.5];
  return corners.flatMap((corner, i) => [line(eye, corner), line(corner, corners[(i + 1) % 4])]);
}

function drawPictures(tile, corners, depth) {
  if (tile.textures.images) stage.drawPicture(tile.textures.images, corners, depth);
  if (tile.textures.masks) stage.drawPicture(tile.textures.masks, corners, depth, [...colours.mask, tile.textures.images ? 0.45 : 0.7]);
}

let stage = null;
function draw() {
  const ratio = Math.min(devicePixelRatio, 2) * (slow() ? 0.7 : 1);
  const size = [part.world.clientWidth, part.world.clientHeight].map((s) => Math.max(1, Math.round(s * ratio)));
  if (part.world.width !== size[0] || part.world.height !== size[1]) [part.world.width, part.world.height] = size;
  const view = state.through === null ? orbit.view(size) : pinholes[state.through].within(size);
  const reach = camerasReach();
  stage.gl.clearColor(...colours.plate, 1);
  stage.begin(view, 4 * (reach + orbit.distance) + 100);
  track().at(state.position, joints);
  const depth = Math.min(Math.max(0.12 * reach, 0.15), 1);
  if (state.through === null) stage.drawLines(gridLines(), true);
  else {
    const corners = pinholes[state.through].corners(2 * reach);
    drawPictures(tiles[state.through], corners, false);
    stage.drawLines(cameraLines(corners, pinholes[state.through].eye, true), false);
  }
  stage.drawSkin(joints, add(view.R[2], content.up, -0.6).map((v, i, a) => -v / Math.hypot(...a)),
    [...colours.skin, state.through === null ? 1 : 0.6], slow() ? stage.coarse : stage.fine);
  stage.drawLines(skeletonLines(), false);
  if (state.through === null) {
    pinholes.forEach((pinhole, k) => {
      const corners = pinhole.corners(depth);
      drawPictures(tiles[k], corners, true);
      stage.drawLines(cameraLines(corners, pinhole.eye, false), true);
    });
  }
  placeLabels(view, ratio);
}

function placeLabels(view, ratio) {
  [...part.labels.children].forEach((label, k) => {
    const at = state.through === null ? view.pixel(pinholes[k].eye) : null;
    label.hidden = !at;
    if (at) [label.style.left, label.style.top] = at.map((value) => `${value / ratio}px`);
  });
}

// The page is drawn when something has changed, once before the screen's next picture.
// While it plays where that takes too long, as without a GPU, the tracking mesh is drawn for the skin, in fewer pixels,
// and the cameras' pictures are renewed now and then.
const SLOW = 1000 / 40; // [ms] between two pictures
const RENEWED = 100; // [ms]
let asked = false, before = null, pace = 0, renewed = 0;
const slow = () => state.playing && pace > SLOW;

function renewPictures(i, overlap) {
  const keep = slow() && performance.now() - renewed < RENEWED;
  if (!keep) renewed = performance.now();
  tiles.forEach((tile, k) => tile.show(i, overlap[k], keep));
}

function refresh() {
  if (asked) return;
  asked = true;
  requestAnimationFrame((now) => {
    asked = false;
    if (state.playing && before !== null) {
      if (pace <= SLOW) pace += 0.2 * (now - before - pace);
      advance(Math.min((now - before) / 1000, 0.25));
    }
    before = state.playing ? now : null;
    show();
    if (state.playing) refresh();
  });
}

function show() {
  const i = frame(), run = content.runs[state.run];
  const seen = overlaps[state.run].subarray(i * cameras.length, (i + 1) * cameras.length);
  part.slider.value = i;
  part.where.textContent = `Frame ${frames[i]}, ${seconds[i].toFixed(2)} s, ${content.statuses[run.status[i]]}`;
  part.slider.setAttribute("aria-valuetext", part.where.textContent);
  renewPictures(i, seen);
  part.age.textContent = state.through === null ? "" : tiles[state.through].age.textContent;
  for (const curve of curves) curve.show(i, trackName());
  if (stage) draw();
}

function turnByPointer(canvas) {
  const held = new Map();
  const middle = () => [...held.values()].reduce((sum, at) => add(sum, at, 1 / held.size), [0, 0]);
  const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(...add(a, b, -1)); };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId) || state.through !== null) return;
    const [was, apart] = [middle(), held.size === 2 ? spread() : 0];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    const [right, down] = add(middle(), was, -1);
    if (held.size === 2) orbit.nearer(apart / Math.max(spread(), 1));
    if (held.size === 2 || event.shiftKey) orbit.move(right, down, orbit.view([canvas.clientWidth, canvas.clientHeight]));
    else orbit.turn(-right / 150, down / 150);
    refresh();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (state.through === null) orbit.nearer(Math.exp(event.deltaY / 600));
    refresh();
  }, { passive: false });
}

const step = (by) => () => { play(false); seek(state.position + by); };
const view = (change) => () => { change(); refresh(); };
const KEYS = {
  " ": () => play(!state.playing),
  ArrowLeft: step(-1),
  ArrowRight: step(1),
  Home: step(-Infinity),
  End: step(Infinity),
  r: () => { part.raw.checked = !part.raw.checked; refresh(); },
  "+": view(() => orbit.nearer(0.9)),
  "=": view(() => orbit.nearer(0.9)),
  "-": view(() => orbit.nearer(1 / 0.9)),
  0: () => lookThrough(null),
  Escape: () => lookThrough(null),
  ...Object.fromEntries(cameras.slice(0, 9).map((_, k) => [k + 1, () => lookThrough(k)])),
};
const SHIFTED = {
  ArrowLeft: view(() => orbit.turn(-0.1, 0)),
  ArrowRight: view(() => orbit.turn(0.1, 0)),
  ArrowUp: view(() => orbit.turn(0, 0.1)),
  ArrowDown: view(() => orbit.turn(0, -0.1)),
};

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const kind = event.target.localName;
  const own = kind === "select" || (event.key === " " && ["button", "input", "summary"].includes(kind) && event.target !== part.slider);
  const action = (event.shiftKey && SHIFTED[event.key]) || KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (own || !action) return;
  event.preventDefault();
  action();
});

part.slider.max = last;
part.slider.addEventListener("input", () => { const to = Number(part.slider.value); play(false); seek(to); });
part.play.addEventListener("click", () => play(!state.playing));
part.raw.addEventListener("change", refresh);
part.raw.disabled = false;
part.run.append(...content.runs.map((run, i) => element("option", { value: i, textContent: run.name })));
part.run.value = state.run;
part.run.addEventListener("change", () => chooseRun(Number(part.run.value)));
part.runs.hidden = content.runs.length < 2;
part.free.addEventListener("click", () => lookThrough(null));
part.play.form.addEventListener("submit", (event) => event.preventDefault());

try {
  stage = new Stage(part.world, body);
} catch {
  part.trouble.hidden = false;
}
const tiles = cameras.map((camera, k) => new Tile(camera, k));
part.cameras.append(...tiles.map((tile) => element("li", {}, [tile.button])));
part.labels.append(...cameras.map((_, k) => element("span", { textContent: k + 1 })));
placeView();
turnByPointer(part.world);
new ResizeObserver(refresh).observe(part.world);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
readColours();
chooseRun(state.run);
