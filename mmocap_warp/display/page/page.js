const content = JSON.parse(document.getElementById("content").textContent);
const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((made) => [made.id, made]));
const { body, cameras, frames, fps } = content;
const joints = new Float32Array(8 * body.joints.length);
// Who is shown, the best run of each of the others; only where there are others do they have names and colours.
const people = [{ ...content.person, body, joints }, ...content.others.map((other) => ({
  ...other, joints: new Float32Array(8 * other.body.joints.length), track: new Track(other.motion, other.body.joints.length),
}))];
const pinholes = cameras.map((camera) => Pinhole.of(camera));
const seconds = frames.map((number) => (number - frames[0]) / fps);
const last = frames.length - 1;
const tracks = content.runs.map((run) => Object.fromEntries(
  Object.entries(run.tracks).map(([name, motion]) => [name, new Track(motion, body.joints.length)])));
const overlaps = content.runs.map((run) => unpack(run.iou));
const sigmas = content.runs.map((run) => run.sigma && unpack(run.sigma));
const truth = content.truth && new TruePlaces(content.truth);
const points = (content.points || []).map((run) => new TruePlaces(run)); // of a joint set, by run
const ALL = "all"; // cameras side by side
const state = { position: 0, playing: false, run: content.best, through: null, pointer: null };
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let curves = [];
let views = []; // that are drawn: each one's camera (null: none), pinhole, and left and top in the canvas

const pins = new Pins(cameras);

// What is shown: a frame, or a place between two while it plays.
const trackName = () => (part.raw.checked && tracks[state.run].raw ? "raw" : "final");
const track = () => tracks[state.run][trackName()];
const frame = () => Math.min(Math.round(state.position), last);

function seek(position) {
  state.position = Math.min(Math.max(position, 0), last);
  linkFrame();
  refresh();
}

// The address ends in the frame that is shown: a link to it.
let linking;
function linkFrame() {
  clearTimeout(linking); // browsers refuse more than a few changes a second
  linking = setTimeout(() => {
    try {
      history.replaceState(null, "", `#frame=${frames[frame()]}`);
    } catch { /* a page within a notebook has no address */ }
  }, 300);
}

function seekLinked() {
  const asked = /^#frame=(-?\d+)$/.exec(location.hash);
  if (!asked) return;
  const off = frames.map((number) => Math.abs(number - Number(asked[1])));
  play(false);
  seek(off.indexOf(Math.min(...off)));
}

function play(playing) {
  if (playing && state.position >= last) state.position = 0;
  if (!playing) state.position = frame();
  state.playing = playing;
  part.play.textContent = playing ? "Pause" : "Play";
  part.play.setAttribute("aria-pressed", String(playing));
  if (!playing) linkFrame();
  refresh();
}

function advance(elapsed) {
  const now = Math.floor(state.position);
  const rest = state.position - now;
  const span = (i) => seconds[Math.min(i + 1, last)] - seconds[Math.min(i, last)];
  const time = seconds[now] + rest * span(now) + elapsed * Number(part.speed.value);
  if (time >= seconds[last]) {
    if (calm.matches) play(false);
    state.position = calm.matches ? last : 0; // and again
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
  part.raw.parentElement.hidden = !tracks[run].raw;
  part.deviations.parentElement.hidden = !sigmas[run];
  refresh();
}

function lookThrough(k) {
  state.through = (k === ALL || k < cameras.length) && k !== state.through ? k : null;
  part.free.hidden = state.through === null;
  part.free.firstChild.textContent = state.through === ALL ? "Leave the cameras " : "Leave the camera ";
  part.all.setAttribute("aria-pressed", String(state.through === ALL));
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
      const picture = element("img", { alt: "" });
      picture.addEventListener("load", () => {
        if (stage) this.textures[kind] = stage.loadPicture(picture, this.textures[kind]);
        refresh();
      });
      this.pictures[kind] = picture;
      if (kind === "images") seen.append(picture);
      else {
        this.tint = element("span", { className: withImages ? "tint over" : "tint" }, [picture]);
        seen.append(this.tint);
      }
    }
    const wide = 320;
    this.bones = element("canvas", { width: wide, height: Math.round((wide * camera.size[1]) / camera.size[0]) });
    this.pinhole = pinholes[k];
    seen.append(this.bones);
    this.overlap = element("span");
    this.age = element("span", { className: "age" });
    seen.append(this.age);
    const name = element("span", { textContent: `${k + 1} ${camera.name}`, title: camera.name });
    this.button = element("button", { type: "button" }, [
      seen, element("span", { className: "words" }, [name, this.overlap]),
    ]);
    this.button.setAttribute("aria-pressed", "false");
    this.button.addEventListener("click", () => lookThrough(k));
  }

  show(i, overlap, keep) {
    drawBones(this.bones, this.pinhole, part.skeleton.checked ? people.map(({ body: of, joints: at, colour }) => (
      [of, at, colour ? sides(colour) : content.onPictures])) : []);
    if (this.tint) this.tint.hidden = !part.mask.checked;
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
    this.overlap.textContent = Number.isFinite(overlap) ? `IoU ${overlap.toFixed(3)}` : "not used";
  }
}

// Colours follow the page's, light or dark; over pictures they are those of the dark one.
const style = (name) => hex(getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
const table = [0, 1].map((i) =>
  Object.fromEntries(Object.entries(content.colours).map(([name, both]) => [name, hex(both[i])])));
content.onPictures = Object.fromEntries(Object.entries(content.colours).map(([name, both]) => [name, both[1]]));
const sides = (colour) => ({ left: colour, right: colour, middle: colour });
let colours, bright;
function readColours() {
  const page = Object.fromEntries(["plate", "grid", "soft", "accent"].map((name) => [name, style(name)]));
  bright = { ...table[1], ...page, plate: hex("#101215") };
  colours = { ...table[Number(dark.matches)], ...page };
  refresh();
}
const dark = matchMedia("(prefers-color-scheme: dark)");

let orbit;
function placeView() {
  const corners = [track(), ...content.others.map((_, i) => people[i + 1].track)].map((each) => each.extent());
  const [low, high] = [Math.min, Math.max].map((most, i) => [0, 1, 2].map((axis) => most(...corners.map((of) => of[i][axis]))));
  const middle = add(low, high).map((value) => value / 2);
  const radius = Math.max(Math.hypot(...add(high, low, -1)) / 2, 0.1);
  const front = turning(track().at(0, joints)).map((row) => row[2]); // where the body's +Z points in the first frame
  orbit = new Orbit(middle, 3.8 * radius, content.up, front);
  orbit.reach = radius;
  refresh();
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

function skeletonLines(of = colours) {
  return people.flatMap(({ body: own, joints: at, colour }) => boneLines(own, at, colour ? sides(hex(colour)) : of));
}

function cameraLines(corners, eye, chosen) {
  const line = (from, to) => [...from, ...to, ...(chosen ? colours.accent : colours.soft), 1, 1.5];
  return corners.flatMap((corner, i) => [line(eye, corner), line(corner, corners[(i + 1) % 4])]);
}

function drawPictures(tile, corners, depth) {
  if (tile.textures.images) stage.drawPicture(tile.textures.images, corners, depth);
  if (!tile.textures.masks || !part.mask.checked) return;
  stage.drawPicture(tile.textures.masks, corners, depth, [...colours.mask, tile.textures.images ? 0.45 : 0.7]);
}

// What is shown in a window of that size.
function viewsIn(size) {
  if (state.through === null) return [{ camera: null, pinhole: orbit.view(size), left: 0, top: 0 }];
  if (state.through !== ALL) {
    return [{ camera: state.through, pinhole: pinholes[state.through].within(size), left: 0, top: 0 }];
  }
  return cells(size, cameras.map(({ size: of }) => of)).map(([left, top, width, height], k) => (
    { camera: k, pinhole: pinholes[k].within([width, height]), left, top }));
}

let stage = null;
function draw() {
  const ratio = Math.min(devicePixelRatio, 2) * (slow() ? 0.7 : 1);
  const size = [part.world.clientWidth, part.world.clientHeight].map((s) => Math.max(1, Math.round(s * ratio)));
  if (part.world.width !== size[0] || part.world.height !== size[1]) [part.world.width, part.world.height] = size;
  views = viewsIn(size);
  for (const each of views) drawView(each, size[1]);
  placeLabels(ratio);
}

function drawView({ camera, pinhole, left, top }, high) {
  const reach = camerasReach(), free = camera === null, of = free ? colours : bright;
  stage.begin(pinhole, 4 * (reach + orbit.distance) + 100, [left, high - top - pinhole.size[1]], of.plate);
  if (free) stage.drawLines(gridLines(), true);
  else {
    const corners = pinholes[camera].corners(2 * reach);
    drawPictures(tiles[camera], corners, false);
    stage.drawLines(cameraLines(corners, pinholes[camera].eye, true), false);
  }
  if (part.mesh.checked) {
    const light = add(pinhole.R[2], content.up, -0.6).map((v, i, a) => -v / Math.hypot(...a));
    people.forEach(({ joints: at, colour }, i) => stage.drawSkin(at, light,
      [...(colour ? hex(colour) : of.model), free ? 1 : 0.6], slow() ? "coarse" : "fine", i));
  }
  if (part.skeleton.checked) {
    stage.drawLines(skeletonLines(of), false);
    if (points.length) stage.drawLines(points[state.run].lines(frame(), of.deviations), false);
  }
  const sigma = sigmas[state.run], size = 3 * body.joints.length;
  if (sigma && part.deviations.checked) {
    const now = sigma.subarray(frame() * size, (frame() + 1) * size);
    stage.drawLines(deviationLines(joints, now, content.deviations, of.deviations), false);
  }
  if (truth && part.truth.checked) stage.drawLines(truth.lines(frame(), of.truth), false);
  if (!free) return;
  const depth = Math.min(Math.max(0.12 * reach, 0.15), 1);
  pinholes.forEach((each, k) => {
    const corners = each.corners(depth);
    drawPictures(tiles[k], corners, true);
    stage.drawLines(cameraLines(corners, each.eye, false), true);
  });
}

// Cameras' numbers in the world, their names in their cells, and joints' names: that below the pointer, or all.
const NEAR = 14; // pixels of the window
function placeLabels(ratio) {
  const put = (label, at) => {
    label.hidden = !at;
    if (at) [label.style.left, label.style.top] = at.map((value) => `${value / ratio}px`);
  };
  cameraLabels.forEach((label, k) => {
    const cell = state.through === ALL ? views[k] : null;
    label.className = cell ? "corner" : "";
    label.textContent = cell ? `${k + 1} ${cameras[k].name}  ${tiles[k].overlap.textContent}` : k + 1;
    put(label, cell ? lowerLeft(cell) : state.through === null && views[0].pinhole.pixel(pinholes[k].eye));
  });
  const hovered = jointBelow(ratio);
  const all = part.names.checked && views.length === 1 ? views[0] : null;
  const named = jointLabels.map((label, j) => {
    const of = hovered?.joint === j ? hovered.view : all;
    const at = of && of.pinhole.pixel(placeOf(joints, j));
    return { label, at: at && [at[0] + of.left, at[1] + of.top] };
  });
  apart(named.filter(({ at }) => at), ratio);
  for (const { label, at } of named) put(label, at);
  for (const old of part.labels.querySelectorAll(".person, .cross")) old.remove();
  // Names of people over their highest joints.
  for (const each of content.others.length ? views : []) {
    for (const { name, colour, body: own, joints: at } of people) {
      const places = own.joints.map((_, j) => placeOf(at, j));
      const highest = places.reduce((a, b) => (dot(a, content.up) > dot(b, content.up) ? a : b));
      const pixel = each.pinhole.pixel(add(highest, content.up, 0.2));
      if (!pixel || pixel.some((value, axis) => value < 0 || value > each.pinhole.size[axis])) continue;
      const label = element("span", { className: "person", textContent: name });
      label.style.color = colour;
      part.labels.append(label);
      put(label, [pixel[0] + each.left, pixel[1] + each.top]);
    }
  }
  // Crosses of the frame's pins.
  if (part.pins.hidden) return;
  for (const each of views.filter(({ camera }) => camera !== null)) {
    for (const { joint, at } of pins.crosses(frames[frame()], each)) {
      const cross = element("span", { className: "cross", textContent: "+", title: joint });
      part.labels.append(cross);
      put(cross, at);
    }
  }
}

function pinJoints(pinning) {
  part.pins.hidden = !pinning;
  part.pin.setAttribute("aria-pressed", String(pinning));
  if (pinning) {
    play(false);
    if (state.through === null) lookThrough(ALL);
  }
  refresh();
}

function listPins() {
  part.pinned.replaceChildren(...pins.all.map((pin) => {
    const seen = [...pin.planes.keys()].map((k) => cameras[k].name).join(", ");
    const remove = element("button", { type: "button", textContent: `Remove ${pin.joint} in frame ${pin.frame}` });
    remove.addEventListener("click", () => { pins.remove(pin); listPins(); });
    const words = pin.planes.size < 2 ? `${seen}: one camera more is needed` : seen;
    return element("li", {}, [`Frame ${pin.frame}, ${pin.joint}: ${words} `, remove]);
  }));
  part.file.value = pins.toml();
  refresh();
}

// Moves names down that would lie on others.
function apart(named, ratio) {
  const wide = (a, b) => 4.5 * ratio * (a.label.textContent.length + b.label.textContent.length), high = 20 * ratio;
  const meet = (a, b) => Math.abs(a.at[0] - b.at[0]) < wide(a, b) && Math.abs(a.at[1] - b.at[1]) < high;
  named.sort((a, b) => a.at[1] - b.at[1]);
  named.forEach((one, i) => {
    for (const other of named.slice(0, i)) if (meet(one, other)) one.at[1] = other.at[1] + high;
  });
}

// Where a camera's image ends in its cell.
function lowerLeft({ camera, pinhole: { focal, size }, left, top }) {
  const scale = focal[0] / pinholes[camera].focal[0];
  const [width, height] = cameras[camera].size.map((s) => s * scale);
  return [left + (size[0] - width) / 2, top + (size[1] + height) / 2];
}

// The joint that is nearest to the pointer, and the view that it is in.
function jointBelow(ratio) {
  if (!state.pointer) return null;
  let found = null, least = NEAR * ratio;
  const pointer = state.pointer.map((value) => value * ratio);
  for (const each of views) {
    for (let j = 0; j < body.joints.length; j++) {
      const at = each.pinhole.pixel(placeOf(joints, j));
      const off = at ? Math.hypot(at[0] + each.left - pointer[0], at[1] + each.top - pointer[1]) : Infinity;
      if (off < least) [found, least] = [{ joint: j, view: each }, off];
    }
  }
  return found;
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
  track().at(state.position, joints);
  for (const other of people.slice(1)) other.track.at(state.position, other.joints);
  renewPictures(i, seen);
  part.age.textContent = tiles[state.through === ALL ? 0 : state.through]?.age.textContent ?? "";
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
    const box = canvas.getBoundingClientRect();
    state.pointer = held.size ? null : [event.clientX - box.left, event.clientY - box.top];
    refresh();
    if (!held.has(event.pointerId) || state.through !== null) return;
    const [was, apart] = [middle(), held.size === 2 ? spread() : 0];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    const [right, down] = add(middle(), was, -1);
    if (held.size === 2) orbit.nearer(apart / Math.max(spread(), 1));
    if (held.size === 2 || event.shiftKey) orbit.move(right, down, orbit.view([canvas.clientWidth, canvas.clientHeight]));
    else orbit.turn(-right / 150, down / 150);
    refresh();
  });
  canvas.addEventListener("pointerleave", () => { state.pointer = null; refresh(); });
  canvas.addEventListener("click", (event) => {
    if (state.through === null) return;
    const box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width;
    const [x, y] = [event.clientX - box.left, event.clientY - box.top].map((value) => value * ratio);
    const cell = views.find(({ left, top, pinhole: { size } }) =>
      x >= left && x < left + size[0] && y >= top && y < top + size[1]);
    if (!cell) return;
    if (!part.pins.hidden) {
      if (pins.put(frames[frame()], part.joint.value, cell, [x, y])) listPins();
    } else if (state.through === ALL) lookThrough(cell.camera);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (state.through === null) orbit.nearer(Math.exp(event.deltaY / 600));
    refresh();
  }, { passive: false });
}

const step = (by) => () => { play(false); seek(state.position + by); };
const view = (change) => () => { change(); refresh(); };
const layer = (box) => () => { if (!box.parentElement.hidden) box.click(); };
const pacing = (by) => () => {
  const { options, selectedIndex } = part.speed;
  part.speed.selectedIndex = Math.min(Math.max(selectedIndex + by, 0), options.length - 1);
};
const KEYS = {
  " ": () => play(!state.playing),
  ArrowLeft: step(-1),
  ArrowRight: step(1),
  Home: step(-Infinity),
  End: step(Infinity),
  ",": pacing(-1),
  ".": pacing(1),
  a: () => lookThrough(ALL),
  p: () => { if (!part.pin.hidden) pinJoints(part.pins.hidden); },
  v: () => placeView(),
  m: layer(part.mask),
  b: layer(part.mesh),
  s: layer(part.skeleton),
  d: layer(part.deviations),
  t: layer(part.truth),
  n: layer(part.names),
  r: layer(part.raw),
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
for (const box of document.querySelectorAll(".layers input")) box.addEventListener("change", refresh);
part.mask.parentElement.hidden = !cameras.some((camera) => camera.masks.some(Boolean));
part.truth.parentElement.hidden = !truth;
part.sigmas.textContent = `${content.deviations} standard deviations`;
part.all.addEventListener("click", () => lookThrough(ALL));
part.pin.hidden = !cameras.every((camera) => camera.lens);
part.pin.addEventListener("click", () => pinJoints(part.pins.hidden));
part.joint.append(...body.joints.map((name) => element("option", { textContent: name })));
part.copy.addEventListener("click", () => { part.file.select(); document.execCommand("copy"); });
part.reset.addEventListener("click", () => placeView());
part.run.append(...content.runs.map((run, i) => element("option", { value: i, textContent: run.name })));
part.run.value = state.run;
part.run.addEventListener("change", () => chooseRun(Number(part.run.value)));
part.runs.hidden = content.runs.length < 2;
part.free.addEventListener("click", () => lookThrough(null));
part.play.form.addEventListener("submit", (event) => event.preventDefault());

try {
  stage = new Stage(part.world, ...people.map((each) => each.body));
} catch {
  part.trouble.hidden = false;
}
if (content.others.length) { // people's colours are not those of a body and its sides
  for (const swatch of document.querySelectorAll(".layers .model, .layers .left, .layers .right, .layers .middle")) swatch.remove();
  part.skeleton.parentElement.replaceChildren(part.skeleton, "Skeleton");
  document.documentElement.style.setProperty("--mask", content.colours.mask[1]);
}
const tiles = cameras.map((camera, k) => new Tile(camera, k));
part.cameras.append(...tiles.map((tile) => element("li", {}, [tile.button])));
const cameraLabels = cameras.map((_, k) => element("span", { textContent: k + 1 }));
const jointLabels = body.joints.map((name) => element("span", { className: "joint", textContent: name }));
part.labels.append(...cameraLabels, ...jointLabels);
placeView();
turnByPointer(part.world);
new ResizeObserver(refresh).observe(part.world);
dark.addEventListener("change", readColours);
addEventListener("hashchange", seekLinked);
readColours();
chooseRun(state.run);
seekLinked();
