// A job under way: how far it is, and what its silence means.

import React from "React";
import { _, fill } from "./gettext";
import { Button, Notice, Spinner } from "./ui";
import { seconds } from "./words";

export default function Progress({ job, onCancel, onAgain }) {
  const running = job.state === "running";
  const known = running && Number.isFinite(job.percent);
  const percent = known ? Math.round(job.percent) : 0;
  const lost = job.state === "lost";
  const ending = job.state === "cancelling";
  return (
    <div className="vc-body vc-progress">
      <div className="vc-stage" role="status">
        {lost ? null : <Spinner />}
        <strong>{title(job)}</strong>
        {known ? <span className="vc-number">{percent} %</span> : null}
      </div>
      <div className="progress" role="progressbar" aria-valuemin="0" aria-valuemax="100"
        aria-valuenow={known ? percent : undefined} aria-label={title(job)}>
        <div className={`progress-bar progress-bar-success${known || lost ? "" : " vc-waiting"}`}
          style={{ width: known || lost ? `${percent}%` : "100%" }} />
      </div>
      <p className="vc-quiet">{words(job)}</p>
      {lost ? (
        <Notice kind="warning">
          {fill(_("Nothing was heard of it for %(silence)s. The worker may have been restarted or have run out of " +
            "memory. If it comes back, the result appears here; otherwise leave it and measure again, " +
            "with a smaller area if it happens again."), { silence: seconds(job.seconds) || _("a minute") })}
        </Notice>
      ) : null}
      {job.unreachable ? <Notice kind="warning">{job.unreachable} {_("The measurement itself goes on.")}</Notice> : null}
      <div className="vc-tools">
        {lost
          ? <Button primary onClick={onAgain}>{_("Leave it and start anew")}</Button>
          : <Button onClick={onCancel} disabled={ending || !job.job}>{_("Cancel")}</Button>}
      </div>
    </div>
  );
}

function title({ state, stage }) {
  if (state === "running") return stageWords(stage);
  return {
    sending: _("Sending …"),
    queued: _("Waiting for a worker"),
    lost: _("The worker has gone silent"),
    cancelling: _("Cancelling …"),
    done: _("Fetching the result …"),
  }[state] || String(state);
}

function words({ state, elapsed }) {
  const since = seconds(elapsed);
  if (state === "queued") {
    return `${_("It begins as soon as a worker of this server is free. You may close the panel or the page.")}` +
      `${since ? ` (${since})` : ""}`;
  }
  if (state === "running") return since ? fill(_("For %(time)s. You may close the panel or the page."), { time: since }) : "";
  return "";
}

function stageWords(stage) {
  const known = {
    starting: _("Starting"),
    "reading points": _("Reading points"),
    "finding the body": _("Finding the body"),
    "measuring areas": _("Measuring areas"),
    slicing: _("Slicing"),
    drawing: _("Drawing the layers"),
  };
  return known[stage] || (stage ? String(stage) : _("Running"));
}
