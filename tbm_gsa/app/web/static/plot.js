// A picture with axes on a canvas: sharp on any screen, in the colours of the page.

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// Draw again when the size or the colours change, at most once a frame.
export function drawn(canvas, draw) {
  let asked = 0;
  const ask = () => {
    cancelAnimationFrame(asked);
    asked = requestAnimationFrame(draw);
  };
  new ResizeObserver(ask).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
  return ask;
}

export function steps(low, high, count) {
  const raw = (high - low) / count;
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((one) => one * size >= raw) * size;
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-9; value += step) found.push(value);
  return found;
}

export class Plot {
  constructor(canvas, xs, ys, { left = 62, right = 10, top = 10, bottom = 34 } = {}) {
    const ratio = devicePixelRatio || 1;
    const { width, height } = canvas.getBoundingClientRect();
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    this.pen = canvas.getContext("2d");
    this.pen.scale(ratio, ratio);
    this.pen.font = "12px system-ui, sans-serif";
    [this.xs, this.ys] = [xs, ys];
    this.box = { left, top, right: width - right, bottom: height - bottom };
  }

  x(value) {
    return this.box.left + ((value - this.xs[0]) / (this.xs[1] - this.xs[0])) * (this.box.right - this.box.left);
  }

  y(value) {
    return this.box.bottom - ((value - this.ys[0]) / (this.ys[1] - this.ys[0])) * (this.box.bottom - this.box.top);
  }

  // Value at a place of the picture.
  at(x) {
    return this.xs[0] + ((x - this.box.left) / (this.box.right - this.box.left)) * (this.xs[1] - this.xs[0]);
  }

  axes(xTicks, yTicks, xName, yName) {
    const { pen, box } = this;
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const [value, text] of yTicks) {
      pen.strokeStyle = colour("line");
      this.line([[box.left, this.y(value)], [box.right, this.y(value)]]);
      pen.fillStyle = colour("quiet");
      pen.fillText(text, box.left - 6, this.y(value));
    }
    pen.textBaseline = "top";
    pen.textAlign = "center";
    for (const [value, text] of xTicks) {
      pen.strokeStyle = colour("line");
      this.line([[this.x(value), box.bottom], [this.x(value), box.bottom + 4]]);
      pen.fillStyle = colour("quiet");
      pen.fillText(text, this.x(value), box.bottom + 6);
    }
    pen.textAlign = "right";
    pen.fillText(xName, box.right, box.bottom + 20);
    pen.save();
    pen.translate(2, box.top);
    pen.rotate(-Math.PI / 2);
    pen.fillText(yName, 0, 0);
    pen.restore();
  }

  line(points, dash = []) {
    const { pen } = this;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], place) => (place ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.setLineDash([]);
  }

  // All that is drawn next stays within the axes.
  inside(draw) {
    const { pen, box } = this;
    pen.save();
    pen.beginPath();
    pen.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
    pen.clip();
    draw(pen);
    pen.restore();
  }

  words(text) {
    this.pen.fillStyle = colour("quiet");
    this.pen.textAlign = "center";
    this.pen.fillText(text, (this.box.left + this.box.right) / 2, (this.box.top + this.box.bottom) / 2);
  }
}
