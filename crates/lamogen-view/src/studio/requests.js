// Requests to the server. Of several requests for a motion the newest wins: an older answer never replaces it.

/** The number of seconds after which a server that does not answer is asked again. */
const RETRY_SECONDS = 1;

/** An answer that is an error: `problem` has title, detail and, where known, where. */
class Refusal extends Error {
  constructor(problem, retryAfter = null) {
    super(problem.detail ?? problem.title ?? "an error without words");
    Object.assign(this, { problem, retryAfter });
  }
}

class Server {
  /** `token` is sent with every request; null sends none. */
  constructor(token) {
    this.token = token;
  }

  /** Asks, and returns the answer. Throws a Refusal for answers that are errors, and a TypeError if there is none. */
  async ask(path, { accept = "application/json", body, type, signal } = {}) {
    const headers = { accept };
    if (type) headers["content-type"] = type;
    if (this.token !== null) headers.authorization = `Bearer ${this.token}`;
    const answer = await fetch(path, { method: body === undefined ? "GET" : "POST", headers, body, signal, cache: "no-store" });
    if (answer.ok) return answer;
    const text = await answer.text();
    let problem = { title: `status ${answer.status}`, detail: text };
    try {
      problem = JSON.parse(text);
    } catch {
      // The words of an error that is not in our form are shown as they are.
    }
    throw new Refusal(problem, Number(answer.headers.get("retry-after")) || null);
  }

  /** Asks for a motion, and calls `progress` with { done, total, stage } meanwhile. */
  async generate(wish, signal, progress) {
    const answer = await this.ask("api/v1/generate", { accept: "text/event-stream", body: JSON.stringify(wish), type: "application/json", signal });
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = "";
    for (;;) {
      const { value, done } = await reader.read();
      if (done) throw new TypeError("the answer broke off");
      text += value;
      for (let end = text.indexOf("\n\n"); end >= 0; end = text.indexOf("\n\n")) {
        const event = { name: "", data: "" };
        for (const line of text.slice(0, end).split("\n")) {
          const colon = line.indexOf(":");
          const content = line.slice(colon + 1).replace(/^ /, "");
          if (line.startsWith("event:")) event.name = content;
          if (line.startsWith("data:")) event.data += content;
        }
        text = text.slice(end + 2);
        if (event.name === "result") return JSON.parse(event.data);
        if (event.name === "problem") throw new Refusal(JSON.parse(event.data));
        if (event.name === "progress") progress(JSON.parse(event.data));
      }
    }
  }
}

/**
 * Asks for motions one at a time. `shown(result, request)` is called with answers in the order of their requests, `failed(error,
 * request)` with the error of the newest one, `busy(share)` with the progress, from 0 to 1, or null when nothing is going on.
 */
class Requests {
  constructor(server, { shown, failed, busy }) {
    Object.assign(this, { server, shown, failed, busy });
    this.last = 0;
    this.lastShown = 0;
    /** The request that is going on: { number, isCoarse, wish, controller }. */
    this.current = null;
    /** The newest request, if it waits for the one that is going on. */
    this.next = null;
  }

  /**
   * Asks for a motion. `source` is kept with the request. Coarse ones, and with `isPatient` others, let the coarse one before them finish, so
   * that something moves while one drags; others stop whatever goes on.
   */
  ask(wish, { isCoarse, isPatient, source }) {
    const request = { number: (this.last += 1), isCoarse, wish, source, asked: performance.now() };
    // A motion that is being made already is waited for.
    if (this.current && !this.next && this.current.isCoarse === isCoarse && isSame(this.current.wish, wish)) {
      this.current.asked = request.asked;
      return this.current.number;
    }
    if (this.current && this.current.isCoarse && (isCoarse || isPatient)) {
      this.next = request;
      return request.number;
    }
    this.stop();
    this.start(request);
    return request.number;
  }

  /** Stops the request that goes on, and forgets the one that waits. */
  stop() {
    this.next = null;
    if (this.current) this.current.controller.abort();
    this.current = null;
    clearTimeout(this.retry);
  }

  async start(request) {
    request.controller = new AbortController();
    this.current = request;
    const isCurrent = () => this.current === request;
    if (!request.isCoarse) this.busy(0);
    try {
      const result = await this.server.generate(request.wish, request.controller.signal, ({ done, total }) => {
        if (isCurrent() && !request.isCoarse) this.busy(total ? done / total : 0);
      });
      if (!isCurrent() || request.number < this.lastShown) return;
      this.current = null;
      this.lastShown = request.number;
      this.busy(null);
      this.shown(result, request);
    } catch (error) {
      if (!isCurrent()) return;
      this.current = null;
      this.busy(null);
      const isGone = !(error instanceof Refusal);
      this.failed(error, request, isGone);
      // A server that is gone or busy is asked again, until there is a newer wish.
      if (this.next === null && (isGone || error.retryAfter)) {
        const seconds = error.retryAfter ?? RETRY_SECONDS;
        this.retry = setTimeout(() => this.start({ ...request, isCoarse: false }), 1000 * seconds);
      }
    }
    if (this.next) {
      const next = this.next;
      this.next = null;
      this.start(next);
    }
  }
}
