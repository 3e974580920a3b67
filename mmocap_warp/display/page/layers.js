// What lies over a picture or in the world: lines of the skeleton, of deviations and of the truth, and names of joints.
const CIRCLE = 24; // pieces of a circle
const UNKNOWN = 65535; // in the place of a coordinate that is not known

const hex = (colour) => [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16) / 255);

// Where joint `j` is; `joints` (joint, 8) as Track.at writes them.
const placeOf = (joints, j) => [...joints.subarray(8 * j + 4, 8 * j + 7)];

function boneLines(body, joints, colours) {
  return body.parent.flatMap((parent, j) => {
    if (parent < 0) return [];
    return [[...placeOf(joints, parent), ...placeOf(joints, j), ...colours[body.side[j]], 1, 3]];
  });
}

// Three circles around each joint, across the world's axes; `sigma` (joint, 3) in tenths of a millimetre.
function deviationLines(joints, sigma, times, colour) {
  const lines = [];
  for (let j = 0; 3 * j < sigma.length; j++) {
    const radii = [...sigma.subarray(3 * j, 3 * j + 3)].map((tenths) => (times * tenths) / 1e4);
    if (radii.some((radius) => radius === 0)) continue;
    const centre = placeOf(joints, j);
    for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
      const points = Array.from({ length: CIRCLE + 1 }, (_, i) => {
        const point = [...centre];
        point[a] += radii[a] * Math.cos((2 * Math.PI * i) / CIRCLE);
        point[b] += radii[b] * Math.sin((2 * Math.PI * i) / CIRCLE);
        return point;
      });
      for (let i = 0; i < CIRCLE; i++) lines.push([...points[i], ...points[i + 1], ...colour, 1, 1.5]);
    }
  }
  return lines;
}

// True places at each frame, and the bones between them.
class TruePlaces {
  constructor({ names, bones, points }) {
    this.count = names.length;
    this.bones = bones;
    this.points = points;
    this.values = unpack(points.values); // (frame, point, 3)
  }

  place(frame, i) {
    const at = 3 * (frame * this.count + i);
    if (this.values[at] === UNKNOWN) return null;
    return this.points.low.map((low, axis) => low + this.points.step * this.values[at + axis]);
  }

  // Bones, and a small cross at each place.
  lines(frame, colour) {
    const places = Array.from({ length: this.count }, (_, i) => this.place(frame, i));
    const bones = this.bones.map(([a, b]) => [places[a], places[b]]).filter(([a, b]) => a && b);
    const crosses = places.filter(Boolean).flatMap((place) => [0, 1, 2].map((axis) =>
      [-0.015, 0.015].map((off) => place.map((value, i) => value + (i === axis ? off : 0)))));
    return [...bones, ...crosses].map(([from, to]) => [...from, ...to, ...colour, 1, 2]);
  }
}

// Cells of a window of that size, as large as can be, for pictures of the sizes that are given: [left, top, width, height].
function cells(size, sizes) {
  const shape = Math.max(...sizes.map(([width, height]) => width / height));
  const heightOf = (columns) => Math.min(size[0] / columns / shape, size[1] / Math.ceil(sizes.length / columns));
  let columns = 1;
  for (let i = 2; i <= sizes.length; i++) if (heightOf(i) > heightOf(columns)) columns = i;
  const rows = Math.ceil(sizes.length / columns);
  return sizes.map((_, k) => {
    const [left, right] = [k % columns, (k % columns) + 1].map((column) => Math.round((column * size[0]) / columns));
    const [top, bottom] = [0, 1].map((more) => Math.round(((Math.floor(k / columns) + more) * size[1]) / rows));
    return [left, top, right - left, bottom - top];
  });
}

// Draws skeletons over a small picture, without WebGL; each is a body, its joints, and colours.
function drawBones(canvas, pinhole, skeletons) {
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  const seen = pinhole.within([canvas.width, canvas.height]);
  context.lineWidth = 3;
  context.lineCap = "round";
  for (const [body, joints, colours] of skeletons) body.parent.forEach((parent, j) => {
    const [from, to] = [parent, j].map((i) => (i < 0 ? null : seen.pixel(placeOf(joints, i))));
    if (!from || !to) return;
    context.strokeStyle = colours[body.side[j]];
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.stroke();
  });
}
