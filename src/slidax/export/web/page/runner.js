/* Runs programs in a worker, one at a time. While one runs, a new request replaces the waiting one. */

const LONGEST_RUN = 30000;

export class Runner {
  /* - `source`: source text of the worker. */
  constructor(source) {
    this.address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
    this.known = new Set();
    this.ticket = 0;
    this.underWay = null;
    this.waiting = null;
  }

  /* Returns the result of a run; null if a later request replaced it before it began. */
  run(program, inputs) {
    return new Promise((resolve, reject) => {
      this.waiting?.resolve(null);
      this.waiting = { program, inputs, resolve, reject };
      if (!this.underWay) this.next();
    });
  }

  next() {
    const asked = this.waiting;
    if (!asked) return;
    this.waiting = null;
    this.worker ??= this.begun();
    const { program, inputs } = asked;
    this.underWay = { ...asked, ticket: ++this.ticket };
    this.clock = setTimeout(() => this.broken("the run took too long, and was ended"), LONGEST_RUN);
    const first = !this.known.has(program.id);
    this.known.add(program.id);
    this.worker.postMessage({ ticket: this.ticket, id: program.id, program: first ? program : null, inputs });
  }

  begun() {
    const worker = new Worker(this.address);
    this.known.clear();
    worker.onmessage = ({ data }) => {
      if (data.ticket !== this.underWay?.ticket) return;
      const asked = this.underWay;
      clearTimeout(this.clock);
      this.underWay = null;
      if (data.fault) {
        this.known.delete(asked.program.id);
        asked.reject(new Error(data.fault));
      } else asked.resolve(data.result);
      this.next();
    };
    worker.onerror = event => this.broken(event.message || "the worker broke down");
    return worker;
  }

  broken(reason) {
    clearTimeout(this.clock);
    this.worker?.terminate();
    this.worker = null;
    const asked = this.underWay;
    this.underWay = null;
    asked?.reject(new Error(reason));
    this.next();
  }

  stop() {
    this.worker?.terminate();
    this.worker = null;
    URL.revokeObjectURL(this.address);
  }
}
