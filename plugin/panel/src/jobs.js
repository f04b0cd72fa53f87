// Watching a job. WebODM tells nothing by itself, so the panel asks; an answer that does not come
// is not a failure of the job, and is said as what it is.

import { _ } from "./gettext";

const QUICK_MS = 700;
const SLOW_MS = 2000;
const GONE = () => _("The server no longer knows this measurement: the plugin was replaced, or you are no longer " +
  "logged in. Reload the page and measure again.");
const ENDS = ["done", "failed", "cancelled"];

/**
 * Ask for the job's state until it ends. `told` gets each state, and {unreachable: message} while
 * the server does not answer; a lost job is asked for on, as its worker may come back.
 * A `remembered` job that the server has forgotten meanwhile is none to speak of. Returns how to stop.
 */
export function watchJob(api, id, told, { remembered = false } = {}) {
  const began = Date.now();
  let known = !remembered;
  let stopped = false;
  let timer = null;

  async function ask() {
    try {
      const state = await api.job(id);
      if (stopped) return;
      known = true;
      told(state);
      if (ENDS.includes(state.state)) return;
    } catch (error) {
      if (stopped) return;
      if (error.status && error.status < 500) {
        told({ job: id, state: "failed", error: known ? GONE() : null, forgotten: !known });
        return;
      }
      told({ job: id, unreachable: error.message });
    }
    timer = setTimeout(ask, Date.now() - began < 15000 ? QUICK_MS : SLOW_MS);
  }

  ask();
  return () => {
    stopped = true;
    clearTimeout(timer);
  };
}

// A reload of the page must not lose sight of a job that goes on.
const key = (task) => `volcalc.job.${task}`;

export function rememberJob(task, job) {
  try {
    if (job) window.sessionStorage.setItem(key(task), job);
    else window.sessionStorage.removeItem(key(task));
  } catch (e) {
    // Without storage the job is simply not taken up again.
  }
}

export function rememberedJob(task) {
  try {
    return window.sessionStorage.getItem(key(task));
  } catch (e) {
    return null;
  }
}
