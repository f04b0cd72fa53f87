// The plugin's REST API. Every failure becomes an ApiError whose message says what to do.

import { _ } from "./gettext";

const ROOT = "/api/plugins/volcalc";

export class ApiError extends Error {
  constructor(message, status, body) {
    super(message);
    this.status = status;
    this.body = body;
  }
}

function csrfToken() {
  const found = document.cookie.match(/(?:^|;\s*)csrftoken=([^;]*)/);
  return found ? decodeURIComponent(found[1]) : "";
}

const COME_AGAIN = 10;

async function request(method, url, body, times = method === "GET" ? COME_AGAIN : 0) {
  const headers = { Accept: "application/json" };
  if (method !== "GET") headers["X-CSRFToken"] = csrfToken();
  if (body !== undefined) headers["Content-Type"] = "application/json";
  let answer;
  try {
    answer = await fetch(url, {
      method,
      headers,
      credentials: "same-origin",
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch (e) {
    throw new ApiError(_("The server cannot be reached. Check the connection and try again."), 0);
  }
  if (answer.status === 204) return null;
  const data = await answer.json().catch(() => null);
  if (answer.ok && data !== null) return data;
  const rest = Number(answer.headers.get("Retry-After"));
  if (answer.status === 503 && rest > 0 && times > 0) {
    await new Promise((resolve) => setTimeout(resolve, Math.min(rest, 10) * 1000));
    return request(method, url, body, times - 1);
  }
  throw new ApiError(reason(answer.status, data), answer.status, data);
}

function reason(status, data) {
  if (data && typeof data.error === "string") return data.error;
  if (status === 401 || status === 403) {
    return _("You may not do this here. Log in, or ask the project's owner for permission.");
  }
  if (status === 404) {
    return _("The server does not know this task or this measurement any more. Reload the page; " +
      "if the plugin was just installed, restart WebODM.");
  }
  if (status === 413) return _("This is too large for the server. Use fewer vertices or a smaller file.");
  if (status >= 502) return _("The server is not answering just now. Try again in a minute.");
  if (data && typeof data.detail === "string") return data.detail;
  return `${_("The server failed with an error of its own. Its log says more.")} (HTTP ${status})`;
}

/** The API of one task. */
export class TaskApi {
  constructor(taskId) {
    this.taskId = taskId;
    this.root = `${ROOT}/task/${encodeURIComponent(taskId)}`;
  }

  info() {
    return request("GET", `${this.root}/`);
  }

  start(area, options, control, name) {
    return request("POST", `${this.root}/jobs`, { area, options, control, name });
  }

  jobs() {
    return request("GET", `${this.root}/jobs`);
  }

  job(id) {
    return request("GET", `${this.root}/jobs/${encodeURIComponent(id)}`);
  }

  cancel(id) {
    return request("DELETE", `${this.root}/jobs/${encodeURIComponent(id)}`);
  }

  drop(id) {
    return request("POST", `${this.root}/jobs/${encodeURIComponent(id)}/drop`, {});
  }

  startAgain(id) {
    return request("POST", `${this.root}/jobs/${encodeURIComponent(id)}/again`, {});
  }

  result(id) {
    return request("GET", `${this.root}/jobs/${encodeURIComponent(id)}/result`);
  }

  list() {
    return request("GET", `${this.root}/measurements`);
  }

  save(job, name) {
    return request("POST", `${this.root}/measurements`, { job, name });
  }

  saved(id) {
    return request("GET", `${this.root}/measurements/${encodeURIComponent(id)}`);
  }

  rename(id, name) {
    return request("PATCH", `${this.root}/measurements/${encodeURIComponent(id)}`, { name });
  }

  remove(id) {
    return request("DELETE", `${this.root}/measurements/${encodeURIComponent(id)}`);
  }

  again(id, task) {
    const body = task && task !== this.taskId ? { task } : {};
    return request("POST", `${this.root}/measurements/${encodeURIComponent(id)}/again`, body);
  }

  series() {
    return request("GET", `${this.root}/series`);
  }

  exportUrl(id, format, units) {
    const query = format === "html" || format === "csv" ? `&units=${units}` : "";
    return `${this.root}/measurements/${encodeURIComponent(id)}/export?format=${format}${query}`;
  }
}

/** How often the server is asked to go on with what older versions saved, and how long it rests in between. */
export const READING = { times: 200, pause: 500 };

const POINT_CLOUD = /^georeferenced_model\.(laz|las)$/;

/** The tasks of a project that can be measured, as WebODM lists them: [{id, name}]. */
export async function projectTasks(project) {
  const tasks = await request("GET", `/api/projects/${encodeURIComponent(project)}/tasks/?ordering=-created_at`);
  const list = Array.isArray(tasks) ? tasks : tasks.results || [];
  const hasCloud = ({ available_assets: assets }) => !assets || assets.some((asset) => POINT_CLOUD.test(asset));
  return list.filter((task) => task.status === 40 && hasCloud(task)).map(({ id, name }) => ({ id, name }));
}
