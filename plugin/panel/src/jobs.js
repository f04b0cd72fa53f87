// The visitor's own measurements of a task: those that wait or run, and what they came to until it
// is saved or dropped. The server keeps them, so any tab and any browser finds them again. WebODM
// tells nothing by itself: the panel asks, while it is open and one of them goes on.

import { TaskApi } from "./api";

const QUICK_MS = 700;
const SLOW_MS = 2000;
const QUICK_FOR_MS = 15000;

export function goesOn({ state }) {
  return state === "queued" || state === "running";
}

export class MyJobs {
  /**
   * `told` is called after every change, `ended` with the measurement that is followed when it has
   * ended (state "gone": the server knows nothing of it any more).
   */
  constructor(api, told, ended) {
    this.api = api;
    this.told = told;
    this.ended = ended;
    this.rows = []; // as the API gives them, the newest first; each with the id of its task
    this.others = []; // {job, task, taskName}: started here, measured in another task
    this.followed = null; // the id of the one whose progress is on the screen
    this.problem = null; // why the server could not be asked the last time
    this.shown = false;
    this.asked = 0;
    window.addEventListener("focus", this.look);
    document.addEventListener("visibilitychange", this.look);
  }

  destroy() {
    this.told = this.ended = () => {};
    this.show(false);
    window.removeEventListener("focus", this.look);
    document.removeEventListener("visibilitychange", this.look);
  }

  show(shown) {
    if (this.shown === shown) return;
    this.shown = shown;
    if (shown) this.ask();
    else clearTimeout(this.timer);
  }

  /** Another window may have changed something meanwhile. */
  look = () => {
    if (this.shown && !document.hidden) this.ask();
  };

  get busy() {
    return this.rows.some(goesOn);
  }

  find(id) {
    return this.rows.find(({ job }) => job === id) || null;
  }

  /** Take what the overview said; the newest that goes on is followed. */
  begin(rows, shown) {
    this.shown = shown;
    this.rows = this.ofTask(rows, this.api.taskId);
    const going = this.rows.find(goesOn);
    this.followed = going ? going.job : null;
    this.settle();
  }

  /** Follow one that was just started, here or (`taskName`) in another task. */
  start({ job, task, name, taskName }) {
    if (task !== this.api.taskId) this.others.unshift({ job, task, taskName });
    this.rows.unshift({ job, task, name, taskName, state: "queued" });
    this.followed = job;
    this.began = Date.now();
    return this.ask();
  }

  /** Have the progress of one on the screen; null for none. */
  follow(job) {
    this.followed = job;
    this.told();
  }

  async cancel({ job, task }) {
    await new TaskApi(task).cancel(job);
    await this.ask();
  }

  /** Forget one that has ended; one that is gone already is as good as dropped. */
  async drop({ job, task }) {
    try {
      await new TaskApi(task).drop(job);
    } catch (error) {
      if (error.status !== 404) throw error;
    }
    this.others = this.others.filter((other) => other.job !== job);
    this.rows = this.rows.filter((row) => row.job !== job);
    await this.ask();
  }

  async ask() {
    clearTimeout(this.timer);
    const number = (this.asked += 1);
    let rows = null;
    let problem = null;
    let refused = false;
    try {
      const [own, others] = await Promise.all([this.api.jobs(), this.askOthers()]);
      rows = [...others, ...this.ofTask(own, this.api.taskId)];
    } catch (error) {
      problem = error.message;
      refused = error.status >= 400 && error.status < 500;
    }
    if (number !== this.asked) return;
    if (rows) this.rows = rows;
    this.problem = problem;
    this.settle(refused);
  }

  async askOthers() {
    const gone = new Set();
    const rows = await Promise.all(this.others.map(({ job, task, taskName }) =>
      new TaskApi(task).job(job).then((row) => ({ ...row, task, taskName }), (error) => {
        if (error.status !== 404) throw error;
        gone.add(job);
        return null;
      })));
    this.others = this.others.filter(({ job }) => !gone.has(job));
    return rows.filter(Boolean);
  }

  ofTask(rows, task) {
    return (rows || []).map((row) => ({ ...row, task }));
  }

  settle(refused = false) {
    if (this.followed) {
      const row = this.find(this.followed) || { job: this.followed, state: "gone" };
      if (!goesOn(row)) {
        this.followed = null;
        this.ended(row);
      }
    }
    if (this.shown && this.busy && !refused && !document.hidden) {
      const pace = Date.now() - (this.began || 0) < QUICK_FOR_MS ? QUICK_MS : SLOW_MS;
      this.timer = setTimeout(() => this.ask(), pace);
    }
    this.told();
  }
}
