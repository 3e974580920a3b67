// Values against frame. A click, or a drag, seeks.
const SVG = "http://www.w3.org/2000/svg";
const WIDE = 1000, HIGH = 100;

function element(name, properties = {}, children = []) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

class Curve {
  constructor(curve, odd, seek) {
    this.unit = curve.unit;
    this.values = Object.fromEntries(Object.entries(curve.values).map(([name, packed]) => [name, unpack(packed)]));
    this.count = this.values.final.length;
    const known = Object.values(this.values).flatMap((values) => [...values]).filter(Number.isFinite);
    const highest = known.reduce((a, b) => Math.max(a, b)), lowest = known.reduce((a, b) => Math.min(a, b));
    // Lengths start at zero; overlaps end at one.
    [this.low, this.high] = this.unit ? [0, highest * 1.05 || 1] : [Math.min(Math.floor(lowest * 10) / 10, 0.9), 1];
    this.now = element("output");
    this.svg = document.createElementNS(SVG, "svg");
    this.svg.setAttribute("viewBox", `0 0 ${WIDE} ${HIGH}`);
    this.svg.setAttribute("preserveAspectRatio", "none");
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("aria-label", `${curve.name} against frame, from ${this.word(lowest)} to ${this.word(highest)}`);
    this.path("odd", odd.map((i) => `M${this.x(i)} ${HIGH}h0.01`).join(""));
    for (const [name, values] of Object.entries(this.values).reverse()) this.path(name, this.line(values));
    this.mark = this.path("now", "");
    const follow = (event) => {
      if (event.buttons !== 1) return;
      const box = this.svg.getBoundingClientRect();
      seek(Math.round(((event.clientX - box.left) / box.width) * (this.count - 1)));
    };
    this.svg.addEventListener("pointerdown", follow);
    this.svg.addEventListener("pointermove", follow);
    this.figure = element("figure", {}, [
      element("figcaption", {}, [
        element("span", { textContent: this.values.raw ? `${curve.name} (dashed: raw)` : curve.name }), this.now,
      ]),
      element("div", { className: "plot" }, [
        element("div", { className: "scale" }, [
          element("span", { textContent: this.word(this.high) }), element("span", { textContent: this.word(this.low) }),
        ]),
        this.svg,
      ]),
    ]);
  }

  word(value) {
    if (!Number.isFinite(value)) return "–";
    return this.unit ? `${value.toFixed(1)} ${this.unit}` : value.toFixed(3).replace(/\.?0+$/, "");
  }

  x(i) {
    return (WIDE * i) / Math.max(this.count - 1, 1);
  }

  line(values) {
    let path = "", drawing = false;
    values.forEach((value, i) => {
      const known = Number.isFinite(value);
      const y = HIGH * (1 - (value - this.low) / (this.high - this.low));
      if (known) path += `${drawing ? "L" : "M"}${this.x(i).toFixed(2)} ${y.toFixed(2)}`;
      drawing = known;
    });
    return path;
  }

  path(name, line) {
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("class", name);
    path.setAttribute("d", line);
    return this.svg.appendChild(path);
  }

  show(frame, track) {
    this.mark.setAttribute("d", `M${this.x(frame).toFixed(2)} 0V${HIGH}`);
    this.now.textContent = this.word((this.values[track] ?? this.values.final)[frame]);
  }
}
