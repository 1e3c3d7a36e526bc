// Boxes that the user draws over a picture with the pointer.
"use strict";

const guiseBoxes = {
  begin(event) {
    event.preventDefault(); // no picture is dragged away
    const stage = event.currentTarget;
    stage.setPointerCapture(event.pointerId);
    this.shape?.remove();
    this.shape = stage.appendChild(document.createElement("div"));
    this.shape.className = "drawn-box";
    this.from = this.at(event);
  },

  move(event) {
    if (this.from) this.show(this.box(event));
  },

  // The box as shares of width and height, unless it is a mere click.
  end(event) {
    if (!this.from) return undefined;
    const box = this.box(event);
    this.from = undefined;
    if (box[2] - box[0] > 0.005 && box[3] - box[1] > 0.005) return box;
    this.shape.remove();
    return undefined;
  },

  at({ currentTarget, clientX, clientY }) {
    const { left, top, width, height } = currentTarget.getBoundingClientRect();
    const share = (value) => Math.min(1, Math.max(0, value));
    return [share((clientX - left) / width), share((clientY - top) / height)];
  },

  box(event) {
    const to = this.at(event);
    const sides = (pick) => [0, 1].map((axis) => pick(this.from[axis], to[axis]));
    return [...sides(Math.min), ...sides(Math.max)];
  },

  show([x0, y0, x1, y1]) {
    const percent = (value) => `${100 * value}%`;
    Object.assign(this.shape.style, {
      left: percent(x0), top: percent(y0), width: percent(x1 - x0), height: percent(y1 - y0),
    });
  },
};
