// Probe in the page: when samples came, when they were drawn, when keys were pressed.
//
// Times are those of the wall clock, which the samples' stamps have, too. What a frame draws counts
// as drawn in the first task after that frame.
(() => {
  const HEAD_BYTES = 24;
  const wallS = (ms) => (performance.timeOrigin + ms) / 1000;
  const probe = { armS: [], tracesS: [], angles: [], keysS: [], frames: 0, drawn: 0 };
  globalThis.probe = probe;

  const came = [];
  const take = ({ data }) => {
    if (!(data instanceof ArrayBuffer)) return;
    const head = new DataView(data);
    const [rows, columns] = [head.getUint32(4, true), head.getUint32(8, true)];
    const startS = head.getFloat64(16, true);
    const values = new Float32Array(data, HEAD_BYTES, rows * columns);
    for (let row = 0; row < rows; row += 1) came.push(startS + values[row * columns]);
  };
  globalThis.WebSocket = class extends WebSocket {
    constructor(url) {
      super(url);
      this.addEventListener("message", take);
    }
  };

  let hasTraces = false;
  const clear = CanvasRenderingContext2D.prototype.clearRect;
  CanvasRenderingContext2D.prototype.clearRect = function (...box) {
    hasTraces = true;
    clear.apply(this, box);
  };

  addEventListener("keydown", ({ timeStamp }) => probe.keysS.push(wallS(timeStamp)), { capture: true });

  let [shape, batch, undrawn] = ["", [], []];
  const after = new MessageChannel();
  after.port1.onmessage = () => {
    const nowS = wallS(performance.now());
    probe.frames += 1;
    const now = document.querySelector("#arm .link")?.getAttribute("d") ?? "";
    if (now !== shape && batch.length > 0) {
      shape = now;
      probe.drawn += 1;
      const newestS = batch.at(-1);
      probe.armS.push(nowS - newestS);
      const { a, b } = document.querySelector("#arm .hub").getScreenCTM();
      probe.angles.push([newestS, (-Math.atan2(b, a) * 180) / Math.PI]);
    }
    if (!hasTraces) return;
    hasTraces = false;
    for (const stampS of undrawn.splice(0)) probe.tracesS.push(nowS - stampS);
  };
  // Asked for before the page's own frame, and called before it: no sample comes between the two.
  const frame = () => {
    batch = came.splice(0);
    undrawn.push(...batch);
    after.port2.postMessage(null);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
})();
