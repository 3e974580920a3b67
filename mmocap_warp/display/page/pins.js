// Joints that are clicked in cameras' pictures, and the file of them that `mmocap track --again` reads.
// Where a lens puts a point of the ideal image plane in the recorded image [px], as OpenCV has it.
function recordedPixel({ K, distortion, fisheye }, [x, y]) {
  const [a, b, c, d, e] = distortion, r2 = x * x + y * y;
  let at;
  if (fisheye) {
    const r = Math.sqrt(r2), angle = Math.atan(r), s = angle * angle;
    const grown = r > 0 ? (angle * (1 + s * (a + s * (b + s * (c + s * d))))) / r : 1;
    at = [x * grown, y * grown];
  } else {
    const radial = 1 + r2 * (a + r2 * (b + r2 * e));
    at = [x * radial + 2 * c * x * y + d * (r2 + 2 * x * x), y * radial + c * (r2 + 2 * y * y) + 2 * d * x * y];
  }
  return [K[0][0] * at[0] + K[0][1] * at[1] + K[0][2], K[1][1] * at[1] + K[1][2]];
}

class Pins {
  constructor(cameras) {
    this.cameras = cameras;
    this.all = []; // { frame, joint, planes: by camera's number }
  }

  // A click in the view of a camera; false where that is outside the recorded image.
  put(frame, joint, { camera, pinhole, left, top }, [x, y]) {
    const plane = [(x - left - pinhole.centre[0]) / pinhole.focal[0], (y - top - pinhole.centre[1]) / pinhole.focal[1]];
    const { lens } = this.cameras[camera];
    const inside = recordedPixel(lens, plane).every((value, i) => value >= -0.5 && value <= lens.size[i] - 0.5);
    if (!inside) return false;
    let pin = this.all.find((each) => each.frame === frame && each.joint === joint);
    if (!pin) this.all.push(pin = { frame, joint, planes: new Map() });
    pin.planes.set(camera, plane);
    return true;
  }

  remove(pin) {
    this.all = this.all.filter((each) => each !== pin);
  }

  // The crosses of a frame in a view: their joint and place in the canvas.
  crosses(frame, { camera, pinhole, left, top }) {
    return this.all.filter((pin) => pin.frame === frame && pin.planes.has(camera)).map(({ joint, planes }) => ({
      joint,
      at: planes.get(camera).map((value, i) => value * pinhole.focal[i] + pinhole.centre[i] + [left, top][i]),
    }));
  }

  // The file; keys that TOML does not take bare are quoted.
  toml() {
    const key = (name) => (/^[\w-]+$/.test(name) ? name : JSON.stringify(name));
    return this.all.map(({ frame, joint, planes }) => ["[[pin]]", `frame = ${frame}`, `joint = ${JSON.stringify(joint)}`,
      ...[...planes].map(([k, plane]) => {
        const { lens, name } = this.cameras[k];
        return `${key(name)} = [${recordedPixel(lens, plane).map((value) => value.toFixed(1)).join(", ")}]`;
      }), ""].join("\n")).join("\n");
  }
}
