// Cameras as OpenCV has them (x right, y down, z forward, pixel centres at integers); the free view is one of them.
const add = (a, b, share = 1) => a.map((value, i) => value + share * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));

class Pinhole {
  constructor(R, t, focal, centre, size) {
    Object.assign(this, { R, t, focal, centre, size });
  }

  static of(camera) {
    const { K, R, t, size } = camera;
    return new Pinhole(R, t, [K[0][0], K[1][1]], [K[0][2], K[1][2]], size);
  }

  static towards(eye, target, up, focal, size) {
    const ahead = unit(add(target, eye, -1));
    const right = unit(cross(ahead, up));
    const R = [right, cross(ahead, right), ahead];
    return new Pinhole(R, R.map((row) => -dot(row, eye)), [focal, focal], size.map((s) => (s - 1) / 2), size);
  }

  // The same camera with its image as large as fits into a window, in its middle.
  within(size) {
    const scale = Math.min(size[0] / this.size[0], size[1] / this.size[1]);
    const centre = this.centre.map((c, i) => (c + 0.5) * scale + (size[i] - this.size[i] * scale) / 2 - 0.5);
    return new Pinhole(this.R, this.t, this.focal.map((f) => f * scale), centre, size);
  }

  get eye() {
    return [0, 1, 2].map((i) => -this.R.reduce((sum, row, k) => sum + row[i] * this.t[k], 0));
  }

  // The image's corners in the world, at a depth: top left, top right, bottom right, bottom left.
  corners(depth) {
    const [width, height] = this.size;
    const ends = [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]];
    return ends.map((pixel) => {
      const ray = pixel.map((p, i) => (depth * (p - this.centre[i])) / this.focal[i]).concat(depth);
      const seen = add(ray, this.t, -1);
      return [0, 1, 2].map((i) => this.R.reduce((sum, row, k) => sum + row[i] * seen[k], 0));
    });
  }

  pixel(point) {
    const [x, y, z] = this.R.map((row, i) => dot(row, point) + this.t[i]);
    return z > 0.05 ? [(this.focal[0] * x) / z + this.centre[0], (this.focal[1] * y) / z + this.centre[1]] : null;
  }

  // From the world to WebGL's clip space, column by column.
  clip(near, far) {
    const [width, height] = this.size;
    const x = [(2 * this.focal[0]) / width, (2 * (this.centre[0] + 0.5)) / width - 1];
    const y = [(-2 * this.focal[1]) / height, 1 - (2 * (this.centre[1] + 0.5)) / height];
    const depth = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
    const columns = [...[0, 1, 2].map((i) => this.R.map((row) => row[i])), this.t];
    return columns.flatMap(([a, b, c], i) => [
      x[0] * a + x[1] * c, y[0] * b + y[1] * c, depth[0] * c + (i === 3 ? depth[1] : 0), c,
    ]);
  }
}

// A view that turns about a point; `first` is a direction to look from.
class Orbit {
  constructor(target, distance, up, first) {
    const level = add(first, up, -dot(first, up));
    this.ahead = Math.hypot(...level) > 1e-3 ? unit(level) : unit(cross(up, [up[1], up[2], up[0]]));
    this.aside = cross(up, this.ahead);
    Object.assign(this, { target, distance, up, heading: -0.5, height: 0.25 });
  }

  turn(heading, height) {
    this.heading += heading;
    this.height = Math.min(Math.max(this.height + height, -1.5), 1.5);
  }

  nearer(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 0.3), 100);
  }

  // By pixels of the window.
  move(right, down, view) {
    const pixel = this.distance / view.focal[0];
    this.target = add(add(this.target, view.R[0], -right * pixel), view.R[1], -down * pixel);
  }

  view(size) {
    const level = add(this.ahead.map((a) => a * Math.cos(this.heading)), this.aside, Math.sin(this.heading));
    const from = add(level.map((a) => a * Math.cos(this.height)), this.up, Math.sin(this.height));
    const eye = add(this.target, from, this.distance);
    return Pinhole.towards(eye, this.target, this.up, 1.4 * Math.min(...size), size);
  }
}
