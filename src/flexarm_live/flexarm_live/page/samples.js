// Samples: the server's binary frames, and the ring buffer that keeps the last minutes of them.

const MAGIC = 0x464c5831;
const HEAD_BYTES = 24;
const SEQUENCE_SPAN = 2 ** 20;
// So much faster than its usual rate an arm may be sampled, in an experiment.
const FASTER = 2;

/** Rows of a frame: column 0 is the time after `startS`, the others are the channels. */
export function decode(buffer) {
  if (buffer.byteLength < HEAD_BYTES) throw new Error("a frame of samples is too short");
  const head = new DataView(buffer);
  if (head.getUint32(0, true) !== MAGIC) throw new Error("a frame is not one of samples");
  const rows = head.getUint32(4, true);
  const columns = head.getUint32(8, true);
  if (buffer.byteLength !== HEAD_BYTES + 4 * rows * columns) {
    throw new Error(`a frame of ${rows} by ${columns} samples has ${buffer.byteLength} bytes`);
  }
  const values = new Float32Array(buffer, HEAD_BYTES, rows * columns);
  return { startS: head.getFloat64(16, true), rows, columns, values };
}

/** The last `capacity` samples. An index counts from the first sample of the run. */
export class Ring {
  constructor(names, capacity, rateHz) {
    this.names = names;
    this.capacity = capacity;
    this.rateHz = rateHz;
    this.times = new Float64Array(capacity);
    this.columns = new Map(names.map((name) => [name, new Float32Array(capacity)]));
    this.lost = 0;
    this.end = 0;
    // Times are those of a clock, with ten digits: people read them from here on.
    this.originS = 0;
  }

  get begin() {
    return Math.max(0, this.end - this.capacity);
  }

  push({ startS, rows, columns, values }) {
    if (columns !== this.names.length + 1) {
      throw new Error(`a frame has ${columns - 1} channels instead of ${this.names.length}`);
    }
    for (let row = 0; row < rows; row += 1) {
      const at = row * columns;
      const timeS = startS + values[at];
      // Time that steps back is a new run of the rig.
      if (this.end > this.begin && timeS <= this.time(this.end - 1)) this.end = 0;
      if (this.end === 0) this.originS = Math.floor(timeS);
      const slot = this.end % this.capacity;
      this.times[slot] = timeS;
      this.names.forEach((name, k) => {
        this.columns.get(name)[slot] = values[at + 1 + k];
      });
      this.end += 1;
      this.#countLost();
    }
  }

  time(index) {
    return this.times[index % this.capacity];
  }

  value(name, index) {
    return this.columns.get(name)[index % this.capacity];
  }

  /** Value of the newest sample; NaN before the first one. */
  newest(name) {
    return this.end === 0 ? NaN : this.value(name, this.end - 1);
  }

  /** First index that is not earlier than a time. */
  indexAt(timeS) {
    let [low, high] = [this.begin, this.end];
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.time(middle) < timeS) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  #countLost() {
    if (!this.columns.has("sequence_low") || this.end - this.begin < 2) return;
    const [now, before] = [1, 2].map((back) => this.value("sequence_low", this.end - back));
    const lost = ((now - before + SEQUENCE_SPAN) % SEQUENCE_SPAN) - 1;
    // A number that steps back is that of a new run, unless the numbers may have wrapped.
    const passedS = this.time(this.end - 1) - this.time(this.end - 2);
    if (now > before || lost <= FASTER * this.rateHz * passedS) this.lost += Math.max(0, lost);
  }
}

/**
 * What a plot draws of a span: all samples, or the smallest and largest of each bucket, in the
 * order in which they came. Buckets begin at multiples of their size, a power of two: a curve that
 * moves on keeps its shape.
 *
 * @returns {Array} times, then one array of values for each name
 */
export function decimated(ring, names, fromS, toS, buckets) {
  const begin = Math.max(ring.begin, ring.indexAt(fromS) - 1);
  const end = Math.min(ring.end, ring.indexAt(toS) + 1);
  const count = Math.max(0, end - begin);
  if (count <= 2 * buckets) {
    const every = Array.from({ length: count }, (_, k) => begin + k);
    return [
      every.map((index) => ring.time(index)),
      ...names.map((name) => every.map((index) => ring.value(name, index))),
    ];
  }
  const size = 2 ** Math.ceil(Math.log2(count / buckets));
  const spans = [];
  for (let low = Math.floor(begin / size) * size; low < end; low += size) {
    spans.push([Math.max(low, begin), Math.min(low + size, end)]);
  }
  return [
    spans.flatMap(([low, high]) => [ring.time(low), ring.time(Math.floor((low + high) / 2))]),
    ...names.map((name) => extremes(ring.columns.get(name), ring.capacity, spans)),
  ];
}

function extremes(column, capacity, spans) {
  const found = new Array(2 * spans.length);
  spans.forEach(([low, high], k) => {
    let [least, most] = [low % capacity, low % capacity];
    let [leastAt, mostAt] = [low, low];
    for (let index = low; index < high; index += 1) {
      const slot = index % capacity;
      // What is not known yet is not a number, and gives way to the first one.
      if (!(column[slot] >= column[least] || Number.isNaN(column[slot]))) [least, leastAt] = [slot, index];
      if (!(column[slot] <= column[most] || Number.isNaN(column[slot]))) [most, mostAt] = [slot, index];
    }
    const [first, second] = leastAt <= mostAt ? [least, most] : [most, least];
    found[2 * k] = column[first];
    found[2 * k + 1] = column[second];
  });
  return found;
}

// Steps of so many usual ones are holes: samples were lost, or the arm was not sampled.
const HOLE_STEPS = 4;

/** Times and columns with an empty point in each hole: no curve is drawn across it. */
export function withHoles([times, ...columns], shortestS) {
  const usualS = (times.at(-1) - times[0]) / (times.length - 1);
  const longestS = Math.max(shortestS, HOLE_STEPS * usualS);
  const holes = [];
  for (let k = 1; k < times.length; k += 1) if (times[k] - times[k - 1] > longestS) holes.push(k);
  if (holes.length === 0) return [times, ...columns];
  const bounds = [0, ...holes, times.length];
  const joined = (column, between) =>
    holes.flatMap((hole, k) => [...column.slice(bounds[k], hole), between(hole)]).concat(column.slice(bounds.at(-2)));
  return [joined(times, (k) => (times[k - 1] + times[k]) / 2), ...columns.map((column) => joined(column, () => NaN))];
}
