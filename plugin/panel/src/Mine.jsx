// My measurements: those of the visitor that wait, run, or have ended and are not saved.

import React from "React";
import { Acting, askDrop } from "./acting";
import { _, fill } from "./gettext";
import { goesOn } from "./jobs";
import { Bar } from "./Progress";
import { Button, Fold, Icon, IconButton, Notice, Spinner } from "./ui";
import { endWords, stateWords, when } from "./words";

const FEW = 3;

export default class Mine extends Acting {
  state = { asking: null, busy: null, error: null, open: true, all: false };

  render() {
    const { rows, limits, problem } = this.props;
    if (!rows.length) return null;
    const shown = this.state.all ? rows : rows.slice(0, FEW);
    const days = limits.kept_days;
    return (
      <Fold title={_("My measurements")} className="vc-mine" said={rows.length} open={this.state.open}
        onToggle={(open) => this.setState({ open })}>
        <p className="vc-quiet">
          {_("Only you see these, in any browser, until you save or drop them.")}
          {days ? ` ${fill(_("What has ended is kept for %(days)s days."), { days })}` : ""}
        </p>
        {problem ? <Notice kind="warning">{problem}</Notice> : null}
        <ul className="vc-saved">{shown.map((row) => this.renderOne(row))}</ul>
        {rows.length > shown.length ? (
          <Button onClick={() => this.setState({ all: true })}>
            {fill(_("Show all %(count)s"), { count: rows.length })}
          </Button>
        ) : null}
      </Fold>
    );
  }

  renderOne(row) {
    const { job } = row;
    const name = row.name || _("Volume");
    const why = endWords(row);
    const begun = row.created ? when(row.created) : "";
    const until = row.kept_until ? fill(_("kept until %(date)s"), { date: when(row.kept_until) }) : "";
    return (
      <li key={job} className={`theme-border-primary vc-job vc-job-${row.state}`} data-job={job}>
        <div className="vc-saved-head">
          <strong className="vc-clip" title={name}>{name}</strong>
          {this.state.busy === job ? <Spinner /> : null}
        </div>
        <div className="vc-job-state">
          {stateWords(row)}
          {Number.isFinite(row.percent) && row.state === "running" ? <span> · {Math.round(row.percent)} %</span> : null}
          {row.taskName ? <span className="vc-quiet"> · {fill(_("in %(task)s"), { task: row.taskName })}</span> : null}
        </div>
        {goesOn(row) ? <Bar job={row} label={stateWords(row)} /> : null}
        {why ? <Notice kind={row.state === "failed" ? "error" : "warning"}>{why}</Notice> : null}
        <div className="vc-quiet">{[begun, until].filter(Boolean).join(" · ")}</div>
        {this.state.asking === job ? this.renderAsk(job, { ...askDrop(), doing: () => this.props.onDrop(row) })
          : this.renderActions(row, name)}
        {this.renderError(job)}
      </li>
    );
  }

  renderActions(row, name) {
    const { job, state } = row;
    const { info, onFollow, onCancel, onOpen, onSave, onAgain, onDrop } = this.props;
    const busy = this.state.busy === job;
    const labelled = (words) => ({ disabled: busy, "aria-label": `${words}: ${name}` });
    if (goesOn(row)) {
      return (
        <div className="vc-tools">
          <Button onClick={() => onFollow(job)} {...labelled(_("Show progress"))}>{_("Show progress")}</Button>
          <Button onClick={() => this.act(job, () => onCancel(row))} {...labelled(_("Cancel"))}>{_("Cancel")}</Button>
        </div>
      );
    }
    const done = state === "done";
    return (
      <div className="vc-tools">
        {done
          ? <Button primary onClick={() => this.act(job, () => onOpen(row))} {...labelled(_("Open"))}>{_("Open")}</Button>
          : null}
        {done && info.can_change
          ? <Button onClick={() => this.act(job, () => onSave(row))} {...labelled(_("Save"))}>{_("Save")}</Button>
          : null}
        {!done && info.can_run ? (
          <Button onClick={() => this.act(job, () => onAgain(row))} {...labelled(_("Start again"))}>
            <Icon name="again" /> {_("Start again")}
          </Button>
        ) : null}
        <IconButton icon="trash" label={fill(_("Drop %(name)s"), { name })} disabled={busy}
          onClick={() => (done ? this.setState({ asking: job }) : this.act(job, () => onDrop(row)))} />
      </div>
    );
  }
}
