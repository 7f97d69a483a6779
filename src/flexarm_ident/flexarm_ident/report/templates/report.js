// Zoom and read-out of the charts, and motion of the mode shapes. The page can be read without it, and it asks for nothing.
"use strict";
(() => {
  const WIDTH = 10000, HEIGHT = 2000;
  const SMALLEST_DRAG_PX = 8, TALL_DRAG_PX = 30, NEAR_PX = 24, FAR = 0.03, PERIOD_MS = 2000;
  const numbers = (text) => text.split(" ").map(Number);
  const plain = (value, digits) => `${Number(value.toPrecision(digits))}`.replace("-", "\u2212");

  function even(low, high, count, given) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const fits = [1, 2, 5, 10].find((each) => each * power >= 0.999 * rough) * power;
    // A given step holds while it leaves two ticks.
    const step = given && given <= (high - low) / 2 ? given : fits;
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k += 1) found.push(k * step);
    return found;
  }

  function decades(low, high, count) {
    const span = high - low, factors = span < 2 ? [1, 2, 3, 5, 7] : span < 3 ? [1, 2, 5] : [1], found = [];
    for (let power = Math.floor(low); power <= Math.ceil(high); power += 1) {
      for (const factor of factors) found.push(factor * 10 ** power);
    }
    const seen = found.filter((value) => Math.log10(value) >= low && Math.log10(value) <= high);
    return seen.length > 2 ? seen : even(10 ** low, 10 ** high, count);
  }

  /** The points of a path from `marks.py`, in its own units. */
  function points(path) {
    const found = [];
    let x = 0, y = 0;
    for (const part of path.getAttribute("d").match(/[Ml][^A-Za-z]*/g) || []) {
      const given = part.slice(1).match(/-?\d+/g).map(Number), jumps = part[0] === "M";
      for (let i = 0; i < given.length; i += 2) {
        x = jumps ? given[i] : x + given[i];
        y = jumps ? given[i + 1] : y + given[i + 1];
        found.push([x, y]);
      }
    }
    return found;
  }

  function added(parent, tag, className) {
    const node = Object.assign(document.createElement(tag), { className });
    parent.append(node);
    return node;
  }

  /** One plot: the part of it that is shown, its ticks, and the values under the pointer. */
  class Area {
    constructor(node) {
      this.node = node;
      this.svg = node.querySelector("svg");
      this.head = node.previousElementSibling;
      this.x = numbers(node.dataset.x);
      this.y = numbers(node.dataset.y);
      this.counts = numbers(node.dataset.count);
      this.hasX = node.querySelector("i.x") !== null;
      this.cursor = added(node, "i", "cursor");
      this.box = [0, 0, WIDTH, HEIGHT];
    }

    /** What a place of the paths stands for, in the scale of the axis. */
    scaled(axis, place) {
      const [low, high] = this[axis];
      return low + (high - low) * (axis === "x" ? place / WIDTH : 1 - place / HEIGHT);
    }

    value(axis, place) {
      const scaled = this.scaled(axis, place);
      return this.node.dataset.log.includes(axis) ? 10 ** scaled : scaled;
    }

    show(box) {
      this.box = box;
      this.svg.setAttribute("viewBox", box.join(" "));
      this.node.classList.toggle("zoomed", box[2] < WIDTH || box[3] < HEIGHT);
      this.node.querySelectorAll("i.x, i.y, i.z").forEach((tick) => tick.remove());
      const [left, top, width, height] = box;
      const x = [left, left + width].map((place) => this.scaled("x", place));
      const y = [top + height, top].map((place) => this.scaled("y", place));
      const across = this.ticks("x", x).map((place) => `M${left + width * place} ${top}v${height}`);
      const along = this.ticks("y", y).map((place) => `M${left} ${top + height * (1 - place)}h${width}`);
      this.svg.querySelector(".grid").setAttribute("d", [...across, ...along].join(""));
      const [per] = (this.node.dataset.second || "").split(" ").map(Number);
      if (per) this.ticks("z", y.map((end) => end * per));
    }

    /** Write the ticks of an axis and return their places, 0 to 1. */
    ticks(axis, [low, high]) {
      const log = axis !== "z" && this.node.dataset.log.includes(axis);
      const step = axis === "y" ? Number(this.node.dataset.step || 0) : 0;
      const count = this.counts[axis === "x" ? 0 : 1];
      const values = log ? decades(low, high, count) : even(low, high, count, step);
      return values.map((value) => {
        const place = ((log ? Math.log10(value) : value) - low) / (high - low);
        if (axis === "x" && !this.hasX) return place;
        const tick = added(this.node, "i", axis);
        tick.style[axis === "x" ? "left" : "bottom"] = `${100 * place}%`;
        tick.textContent = plain(value, 6);
        return place;
      });
    }

    /** Tell the values at a part of the width, and those of a point near the pointer, if it is here. */
    read(part, height) {
      const rect = this.svg.getBoundingClientRect(), [left, top, width, tall] = this.box;
      const at = left + width * part, up = height === null ? null : top + tall * height;
      this.paths ||= [...this.svg.querySelectorAll("[data-read]")].map((path) => [path, points(path)]);
      const read = [];
      for (const [path, found] of this.paths) {
        if (getComputedStyle(path).display === "none" || !found.length) continue;
        const dots = path.getAttribute("d").includes("h0");
        if (dots && up === null) continue;
        const rise = (y) => (dots ? ((y - up) / tall) * rect.height : 0);
        const away = ([x, y]) => Math.hypot(((x - at) / width) * rect.width, rise(y));
        const best = found.reduce((one, other) => (away(other) < away(one) ? other : one));
        if (away(best) > (dots ? NEAR_PX : FAR * rect.width)) continue;
        const x = dots ? `${plain(this.value("x", best[0]), 4)}: ` : "";
        read.push(`${path.dataset.read} ${x}${this.inUnits(this.value("y", best[1]))}`.trim());
      }
      this.cursor.style.left = `${100 * part}%`;
      this.cursor.classList.add("on");
      const x = plain(this.value("x", at), 4);
      this.head.querySelector(".read").textContent = read.length ? `${x} | ${read.join(", ")}` : x;
    }

    inUnits(value) {
      const [per, ...unit] = (this.node.dataset.second || "").split(" ");
      const other = per ? ` (${plain(value * Number(per), 3)} ${unit.join(" ")})` : "";
      return plain(value, 4) + other;
    }

    leave() {
      this.cursor.classList.remove("on");
      this.head.querySelector(".read").textContent = "";
    }
  }

  function watch(view) {
    const areas = [...view.querySelectorAll(".area")].map((node) => new Area(node));
    const whole = Object.assign(added(areas[0].head, "button", "whole"), { type: "button" });
    whole.textContent = "whole";
    const reset = () => {
      areas.forEach((area) => area.show([0, 0, WIDTH, HEIGHT]));
      whole.classList.remove("on");
    };
    whole.addEventListener("click", reset);
    for (const area of areas) {
      const select = added(area.node, "i", "select");
      let start = null;
      const place = (event) => {
        const rect = area.svg.getBoundingClientRect();
        const parts = [(event.clientX - rect.left) / rect.width, (event.clientY - rect.top) / rect.height];
        return parts.map((part) => Math.min(1, Math.max(0, part)));
      };
      /** The chosen part of the plot, all of its height when the pointer hardly rose; or null. */
      const chosen = (event) => {
        const rect = area.svg.getBoundingClientRect(), end = place(event);
        const [left, right] = [start[0], end[0]].sort((a, b) => a - b);
        const [top, bottom] = [start[1], end[1]].sort((a, b) => a - b);
        if ((right - left) * rect.width < SMALLEST_DRAG_PX) return null;
        const tall = (bottom - top) * rect.height >= TALL_DRAG_PX;
        return [left, tall ? top : 0, right - left, tall ? bottom - top : 1];
      };
      area.node.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        start = place(event);
        area.node.setPointerCapture(event.pointerId);
        event.preventDefault();
      });
      area.node.addEventListener("pointermove", (event) => {
        const [part, height] = place(event);
        areas.forEach((each) => each.read(part, each === area ? height : null));
        const box = start && chosen(event);
        select.classList.toggle("on", Boolean(box));
        ["left", "top", "width", "height"].forEach((side, i) => {
          if (box) select.style[side] = `${100 * box[i]}%`;
        });
      });
      area.node.addEventListener("pointerup", (event) => {
        const box = start && chosen(event);
        start = null;
        select.classList.remove("on");
        if (!box) return;
        whole.classList.add("on");
        areas.forEach((each) => {
          const [left, top, width, height] = each.box, [, down, , tall] = each === area ? box : [0, 0, 1, 1];
          each.show([left + width * box[0], top + height * down, width * box[2], height * tall]);
        });
      });
      area.node.addEventListener("pointercancel", () => { start = null; });
      area.node.addEventListener("pointerleave", () => areas.forEach((each) => each.leave()));
      area.node.addEventListener("dblclick", reset);
    }
  }

  /** Move the bars of a mode shape through its period, slowly. */
  function animate(shape) {
    const area = shape.querySelector(".area"), bars = area.querySelector(".band");
    const [low, high] = numbers(area.dataset.y), parts = numbers(shape.dataset.shape);
    const count = parts.length / 2, still = bars.getAttribute("d");
    const up = (value) => Math.round(HEIGHT * (high - value) / (high - low));
    const play = Object.assign(added(area.previousElementSibling, "button", "play"), { type: "button" });
    play.textContent = "play";
    let frame = null;
    const draw = (time_ms) => {
      const phase = (time_ms / PERIOD_MS) * 2 * Math.PI;
      const bar = (_, k) => {
        const value = parts[2 * k] * Math.cos(phase) - parts[2 * k + 1] * Math.sin(phase);
        const left = WIDTH * (k + 0.2) / count, right = WIDTH * (k + 0.8) / count;
        return `M${left} ${up(0)}V${up(value)}H${right}V${up(0)}z`;
      };
      bars.setAttribute("d", Array.from({ length: count }, bar).join(""));
      frame = requestAnimationFrame(draw);
    };
    play.addEventListener("click", () => {
      cancelAnimationFrame(frame);
      if (frame !== null) bars.setAttribute("d", still);
      frame = frame === null ? requestAnimationFrame(draw) : null;
      play.textContent = frame === null ? "play" : "stop";
    });
  }

  document.querySelectorAll(".view").forEach(watch);
  document.querySelectorAll(".shape").forEach(animate);

  // All plots below each other make a page of twenty screens on a telephone.
  const sections = document.querySelectorAll("section > details"), unfold = (each) => { each.open = true; };
  const unfoldTarget = () => document.getElementById(location.hash.slice(1))?.querySelectorAll("details").forEach(unfold);
  if (matchMedia("(max-width: 30rem)").matches) sections.forEach((each) => { each.open = false; });
  unfoldTarget();
  addEventListener("hashchange", unfoldTarget);
  addEventListener("beforeprint", () => sections.forEach(unfold));
})();
