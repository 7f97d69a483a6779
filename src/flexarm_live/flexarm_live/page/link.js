// Link to the server: one WebSocket, requests with their replies, jobs with their progress.

const LONGEST_WAIT_MS = 4000;
const SILENCE_MS = 2500;
const HARDWARE = "use the hardware stop";

/**
 * Events: `hello`, `state`, `parameters`, `bodies`, `poses` (detail: the message), `samples`
 * (detail: the buffer), `closed` and `silent`. A connection that breaks is made again.
 */
export class Link extends EventTarget {
  #socket = null;
  #number = 0;
  #open = new Map();
  #jobs = new Map();
  #waitMs = 250;
  #watch = 0;
  #stopSocket = null;
  #stopWaits = false;

  /** `stopUrl` is null for a page that may not command; at `dropUrl` a file is sent. */
  constructor(url, stopUrl, dropUrl) {
    super();
    Object.assign(this, { url, stopUrl, dropUrl });
    this.#connect();
  }

  /** Send a request; the promise is its reply's data, or an Error with the reason. */
  request(verb, fields = {}) {
    if (this.#socket.readyState !== WebSocket.OPEN) {
      return Promise.reject(new Error(`${verb}: there is no connection to the server`));
    }
    return this.#ask(this.#socket, verb, fields);
  }

  #ask(socket, verb, fields = {}) {
    this.#number += 1;
    const id = this.#number;
    socket.send(JSON.stringify({ id, do: verb, ...fields }));
    return new Promise((resolve, reject) => this.#open.set(id, { socket, verb, resolve, reject }));
  }

  /**
   * Send the stop now, over a connection of its own where there is one: no sample is before its
   * answer. The promise is that the server has acknowledged it; else an Error says what to do.
   */
  async stop() {
    const socket = [this.#stopSocket, this.#socket].find((each) => each?.readyState === WebSocket.OPEN);
    this.#stopWaits = socket === undefined;
    if (this.#stopWaits) throw new Error(`NOT SENT: no connection, ${HARDWARE}`);
    const late = new Promise((_, reject) => {
      setTimeout(() => reject(new Error(`sent, and not acknowledged in ${SILENCE_MS / 1000} s`)), SILENCE_MS);
    });
    try {
      await Promise.race([this.#ask(socket, "stop"), late]);
    } catch (error) {
      throw new Error(`STOP ${error.message}, ${HARDWARE}`);
    }
  }

  /** Begin a job; `began` gets its number, `news` each message, the promise its last one's data. */
  async job(verb, fields, { began, news }) {
    const { job } = await this.request(verb, fields);
    began(job);
    return new Promise((resolve, reject) => this.#jobs.set(job, { verb, news, resolve, reject }));
  }

  /** Return a connection for the pieces of one file, and a text at its end; it answers once. */
  dropSocket(name) {
    return new WebSocket(`${this.dropUrl}name=${encodeURIComponent(name)}`);
  }

  #connect() {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.#connectStop();
    socket.addEventListener("open", () => {
      this.#waitMs = 250;
      if (this.#stopWaits) this.stop().catch(() => {});
    });
    socket.addEventListener("message", ({ data }) => this.#receive(data));
    socket.addEventListener("close", ({ reason }) => this.#lose(reason));
    this.#socket = socket;
  }

  #connectStop() {
    if (this.stopUrl === null || (this.#stopSocket?.readyState ?? WebSocket.CLOSED) !== WebSocket.CLOSED) return;
    const socket = new WebSocket(this.stopUrl);
    socket.addEventListener("message", ({ data }) => this.#answer(JSON.parse(data)));
    socket.addEventListener("close", () => this.#forget(socket));
    this.#stopSocket = socket;
  }

  #forget(socket) {
    for (const [id, asked] of this.#open) {
      if (asked.socket !== socket) continue;
      this.#open.delete(id);
      asked.reject(new Error("the connection to the server broke"));
    }
  }

  #receive(data) {
    this.#heard();
    if (data instanceof ArrayBuffer) {
      this.#emit("samples", data);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "reply") this.#answer(message);
    else if (message.type === "job") this.#progress(message);
    else {
      if (message.type === "state") this.#missEnds(message.jobs);
      this.#emit(message.type, message);
    }
  }

  #answer({ id, ok, message, data }) {
    const asked = this.#open.get(id);
    if (asked === undefined) return;
    this.#open.delete(id);
    if (ok) asked.resolve(data ?? {});
    else asked.reject(new Error(`${asked.verb}: ${message}`));
  }

  #progress(message) {
    const job = this.#jobs.get(message.id);
    if (job === undefined) return;
    job.news(message);
    if (!message.done) return;
    this.#jobs.delete(message.id);
    if (message.ok) job.resolve(message.data ?? {});
    else job.reject(new Error(`${job.verb}: ${message.message}`));
  }

  // The end of a job is told once, and to nobody while the connection is broken.
  #missEnds(atWork) {
    for (const [number, { verb, reject }] of this.#jobs) {
      if (atWork.includes(number)) continue;
      this.#jobs.delete(number);
      reject(new Error(`${verb}: the job ended while the page was disconnected; its records and models are there`));
    }
  }

  #lose(reason) {
    clearTimeout(this.#watch);
    this.#forget(this.#socket);
    this.#emit("closed", reason);
    setTimeout(() => this.#connect(), this.#waitMs);
    this.#waitMs = Math.min(2 * this.#waitMs, LONGEST_WAIT_MS);
  }

  // The server sends its state twice a second: silence is a state of its own.
  #heard() {
    clearTimeout(this.#watch);
    this.#watch = setTimeout(() => this.#emit("silent"), SILENCE_MS);
  }

  #emit(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}
