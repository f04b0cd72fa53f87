// A measurement under way: how far it is, and what its silence means.

import React from "React";
import { Acting } from "./acting";
import { _, fill } from "./gettext";
import { Button, Notice, Spinner } from "./ui";
import { seconds, span, stateWords } from "./words";

export default class Progress extends Acting {
  render() {
    const { job, problem, onCancel, onLeave, children } = this.props;
    const ending = this.state.busy === "cancel";
    const title = ending ? _("Cancelling …") : stateWords(job);
    return (
      <div className="vc-body vc-progress">
        <div className="vc-stage" role="status">
          <Spinner />
          <strong>{title}</strong>
          {isKnown(job) ? <span className="vc-number">{Math.round(job.percent)} %</span> : null}
        </div>
        {job.name ? <div className="vc-clip" title={job.name}>{job.name}</div> : null}
        <Bar job={job} label={title} />
        <p className="vc-quiet">{this.words()}</p>
        {problem ? <Notice kind="warning">{problem} {_("The measurement itself goes on.")}</Notice> : null}
        {job.job ? (
          <div className="vc-tools">
            <Button onClick={() => this.act("cancel", onCancel)} disabled={ending}>{_("Cancel")}</Button>
            <Button onClick={onLeave} title={_("This one goes on meanwhile")}>{_("Measure another")}</Button>
          </div>
        ) : null}
        {this.renderError("cancel")}
        {children}
      </div>
    );
  }

  words() {
    const { job, limits } = this.props;
    if (!job.job) return "";
    const since = seconds(job.elapsed);
    const kept = _("You may close the panel, the page or the browser: it is found again here.");
    if (job.state === "running") return since ? `${fill(_("For %(time)s."), { time: since })} ${kept}` : kept;
    const begins = _("It begins as soon as a worker of this server is free.");
    const given = limits.queued_lost_after_s
      ? ` ${fill(_("Should the server's queue lose it, you are told so after %(time)s, and can start it again."),
        { time: span(limits.queued_lost_after_s) })}`
      : "";
    return `${begins}${given} ${kept}`;
  }
}

export function Bar({ job, label }) {
  const known = isKnown(job);
  return (
    <div className="progress" role="progressbar" aria-valuemin="0" aria-valuemax="100"
      aria-valuenow={known ? Math.round(job.percent) : undefined} aria-label={label}>
      <div className={`progress-bar progress-bar-success${known ? "" : " vc-waiting"}`}
        style={{ width: known ? `${Math.round(job.percent)}%` : "100%" }} />
    </div>
  );
}

function isKnown({ state, percent }) {
  return state === "running" && Number.isFinite(percent);
}
