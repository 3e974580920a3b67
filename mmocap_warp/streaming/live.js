// Draws bodies as packets come over the WebSocket of the server that this page is from.
const content = JSON.parse(document.getElementById("content").textContent);
const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((made) => [made.id, made]));
const { people, cameras, names } = content; // only where there are several do people have names and colours
for (const each of people) each.joints = new Float32Array(8 * each.body.joints.length); // as Track.at writes them
const pinholes = cameras.map((camera) => Pinhole.of(camera));
const dark = matchMedia("(prefers-color-scheme: dark)");
const style = (name) => hex(getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
let stage = null, orbit = null, asked = false;
try { stage = new Stage(part.world, ...people.map((each) => each.body)); } catch { part.trouble.hidden = false; }
const rows = names.map(() => part.overlaps.appendChild(document.createElement("li")));
const named = (each, text) => (each.name ? `${each.name} ${text}` : text);
if (people.length > 1) part.mesh.parentElement.replaceChildren(part.mesh, ...people.flatMap(({ name, colour }) => {
  const swatch = Object.assign(document.createElement("i"), { className: "swatch" });
  swatch.style.background = colour;
  return [swatch, name];
}));

function show(packet) {
  if (packet.smooth !== part.smooth.checked) return;
  const person = people.find(({ name }) => name === packet.person) ?? people[0];
  person.packet = packet;
  packet.turn.forEach((turn, j) => person.joints.set([...turn, ...packet.place[j]], 8 * j));
  const seen = people.filter((each) => each.packet), age = Math.max(0, Date.now() - 1000 * packet.time);
  rows.forEach((row, k) => {
    const overlaps = seen.filter((each) => each.packet.iou[k] !== null).map((each) => named(each, each.packet.iou[k].toFixed(3)));
    row.textContent = `${names[k]}: ${overlaps.length ? `IoU ${overlaps.join(", ")}` : "nothing seen"}`;
  });
  const statuses = seen.map((each) => named(each, each.packet.status)).join(", ");
  part.told.textContent = `Frame ${packet.frame}, ${statuses}, ${age.toFixed(0)} ms after it was seen, ${packet.dropped} dropped`;
  orbit ??= new Orbit(packet.place[0], 4 * Math.sqrt(people.length), content.up, turning(packet.turn[0]).map((row) => row[2]));
  refresh();
}

function refresh() {
  if (asked || !stage || !orbit) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; draw(); });
}

function draw() {
  const size = [part.world.clientWidth, part.world.clientHeight].map((s) => Math.max(1, Math.round(s * devicePixelRatio)));
  if (part.world.width !== size[0] || part.world.height !== size[1]) [part.world.width, part.world.height] = size;
  const seen = people.filter((each) => each.packet);
  const middle = seen.reduce((sum, each) => add(sum, placeOf(each.joints, 0), 1 / seen.length), [0, 0, 0]);
  orbit.target = add(orbit.target, add(middle, orbit.target, -1), 0.1); // it follows the bodies
  const view = orbit.view(size), soft = style("soft"), grid = style("grid");
  const colours = Object.fromEntries(Object.entries(content.colours).map(([name, both]) => [name, hex(both[Number(dark.matches)])]));
  stage.begin(view, 100, [0, 0], style("plate"));
  stage.drawLines(floor().map((line) => [...line, ...grid, 1, 1.2]), true);
  const towards = add(view.R[2], content.up, -0.6);
  for (const each of seen) {
    const { body, joints, colour } = each, own = colour && hex(colour), light = unit(towards.map((v) => -v));
    if (part.mesh.checked) stage.drawSkin(joints, light, [...(own || colours.model), 1], "fine", people.indexOf(each));
    if (part.skeleton.checked) stage.drawLines(boneLines(body, joints, own ? { left: own, right: own, middle: own } : colours), false);
  }
  for (const pinhole of pinholes) {
    const corners = pinhole.corners(0.5), line = (a, b) => [...a, ...b, ...soft, 1, 1.5];
    stage.drawLines(corners.flatMap((corner, i) => [line(pinhole.eye, corner), line(corner, corners[(i + 1) % 4])]), true);
  }
}

// Squares of a metre at the world's zero, around what is looked at.
function floor() {
  const [a, b] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].filter((axis) => Math.abs(dot(axis, content.up)) < 0.5);
  const middle = add(a.map((v) => v * Math.round(dot(orbit.target, a))), b, Math.round(dot(orbit.target, b)));
  return Array.from({ length: 11 }, (_, i) => i - 5).flatMap((i) => [[a, b], [b, a]].map(([along, across]) => {
    const at = add(middle, across, i);
    return [...add(at, along, -5), ...add(at, along, 5)];
  }));
}

part.world.addEventListener("pointerdown", (event) => part.world.setPointerCapture(event.pointerId));
part.world.addEventListener("pointermove", (event) => {
  if (event.buttons && orbit) orbit.turn(-event.movementX / 150, event.movementY / 150);
  refresh();
});
part.world.addEventListener("wheel", (event) => {
  event.preventDefault();
  orbit?.nearer(Math.exp(event.deltaY / 600));
  refresh();
}, { passive: false });
const KEYS = {
  ArrowLeft: () => orbit.turn(-0.1, 0), ArrowRight: () => orbit.turn(0.1, 0), ArrowUp: () => orbit.turn(0, 0.1),
  ArrowDown: () => orbit.turn(0, -0.1), "+": () => orbit.nearer(0.9), "-": () => orbit.nearer(1 / 0.9),
};
part.world.addEventListener("keydown", (event) => {
  if (!KEYS[event.key] || !orbit) return;
  event.preventDefault();
  KEYS[event.key]();
  refresh();
});
new ResizeObserver(refresh).observe(part.world);

(function connect() {
  const socket = new WebSocket(`ws://${location.host}/`);
  socket.addEventListener("message", ({ data }) => show(JSON.parse(data)));
  socket.addEventListener("close", () => { part.told.textContent = "Nothing is sent."; setTimeout(connect, 1000); });
})();
