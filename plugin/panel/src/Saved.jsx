// The measurements that the task keeps.

import React from "React";
import { Acting } from "./acting";
import { projectTasks } from "./api";
import { _, fill } from "./gettext";
import { Rename } from "./Naming";
import { Button, Icon, IconButton, Notice, Spinner } from "./ui";
import { quantityWords, revisionWords, when } from "./words";

export default class Saved extends Acting {
  state = { asking: null, busy: null, error: null, others: null };

  askAgain(id) {
    this.setState({ asking: { id, what: "again" } });
    if (this.state.others) return;
    const { info, tasks } = this.props;
    projectTasks(info.task.project).then(
      (others) => this.alive && this.setState({ others }),
      () => this.alive && this.setState({ others: tasks.filter((task) => task.project === info.task.project) }),
    );
  }

  render() {
    const { list, info } = this.props;
    return (
      <div className="vc-body">
        {info.lost ? (
          <Notice kind="warning">
            {_("Measurements that were saved here are gone: the task was restarted, which empties its files. " +
              "Measure again, or restore the task from a backup.")}
          </Notice>
        ) : null}
        {!info.can_run && info.reason ? <Notice>{info.reason}</Notice> : null}
        {list === null ? <p className="vc-quiet"><Spinner /> {_("Looking for saved measurements …")}</p> : null}
        {list && !list.length ? this.renderEmpty() : null}
        {list && list.length ? (
          <ul className="vc-saved">
            {list.slice().sort((a, b) => String(b.date).localeCompare(String(a.date))).map((saved) => this.renderOne(saved))}
          </ul>
        ) : null}
      </div>
    );
  }

  renderEmpty() {
    const { info } = this.props;
    return (
      <div className="vc-empty">
        <p><strong>{_("Nothing saved yet")}</strong></p>
        <p className="vc-quiet">
          {info.can_change
            ? _("A measurement that you save stays with the task: everybody who may see the task sees it here.")
            : _("Measurements that the task's owner saves appear here.")}
        </p>
      </div>
    );
  }

  renderOne(saved) {
    const { info, onOpen, onRename, onRemove } = this.props;
    const { asking, busy } = this.state;
    const asked = asking && asking.id === saved.id ? asking.what : null;
    const name = saved.name || _("(unreadable)");
    return (
      <li key={saved.id} className="theme-border-primary">
        <div className="vc-saved-head">
          <Rename name={name} may={info.can_change && saved.readable} onRename={(next) => onRename(saved, next)}>
            <button type="button" className="vc-link vc-clip" disabled={!saved.readable || busy === saved.id}
              onClick={() => this.act(saved.id, () => onOpen(saved.id))}>
              {name}
            </button>
          </Rename>
          {busy === saved.id ? <Spinner /> : null}
        </div>
        {saved.readable ? this.renderSummary(saved) : null}
        {saved.problem || !saved.readable ? (
          <Notice kind={saved.readable ? "note" : "warning"}>{saved.problem || _("The file cannot be read.")}</Notice>
        ) : null}
        <div className="vc-saved-foot">
          <span className="vc-quiet">{[when(saved.date), saved.user].filter(Boolean).join(" · ")}</span>
          <span className="vc-actions">
            {saved.readable ? (
              <IconButton icon="show" label={fill(_("Show %(name)s"), { name })}
                onClick={() => this.act(saved.id, () => onOpen(saved.id))} />
            ) : null}
            {info.can_run && saved.readable ? (
              <IconButton icon="again" label={fill(_("Measure %(name)s again"), { name })}
                onClick={() => this.askAgain(saved.id)} />
            ) : null}
            {info.can_change ? (
              <IconButton icon="trash" label={fill(_("Delete %(name)s"), { name })}
                onClick={() => this.setState({ asking: { id: saved.id, what: "delete" } })} />
            ) : null}
          </span>
        </div>
        {asked === "delete" ? this.renderAsk(saved.id, {
          question: _("Delete this measurement for everybody?"),
          yes: _("Delete"),
          no: _("Keep"),
          doing: () => onRemove(saved),
        }) : null}
        {asked === "again" ? this.renderAgain(saved) : null}
        {this.renderError(saved.id)}
      </li>
    );
  }

  renderSummary({ summary }) {
    const { units, info } = this.props;
    if (!summary) return null;
    const terrain = summary.shape === "terrain";
    const { method_revision: revision } = summary.comparable;
    return (
      <div className="vc-saved-sum">
        <strong>{units.volume(summary.volume_m3, summary.std_m3)}</strong> {units.margin(summary.std_m3)}
        {terrain ? (
          <span className="vc-quiet">
            {` · ${_("cut")} ${units.volumeNumber(summary.cut_m3, summary.std_m3)} · ${_("fill")} ${units.volumeNumber(summary.fill_m3, summary.std_m3)}`}
          </span>
        ) : null}
        {summary.results > 1 ? <span className="vc-quiet"> · {fill(_("%(count)s areas"), { count: summary.results })}</span> : null}
        {terrain && summary.base !== null
          ? <span className="vc-quiet"> · {quantityWords(summary, units).toLowerCase()}</span> : null}
        {revision !== info.method_revision ? <span className="vc-quiet"> · {revisionWords(revision)}</span> : null}
      </div>
    );
  }

  /** The name of another task of the project; nothing for this one. */
  nameOf(task) {
    const other = task !== this.props.info.task.id && (this.state.others || []).find(({ id }) => id === task);
    return other ? other.name || other.id : undefined;
  }

  renderAgain(saved) {
    const { info, onAgain } = this.props;
    const others = (this.state.others || []).filter(({ id }) => id !== info.task.id);
    return (
      <div className="vc-ask" role="group" aria-label={_("Measure again")}>
        <span>{_("Same area, same settings, in")}</span>
        <select className="form-control" aria-label={_("Task to measure in")} ref={(select) => (this.select = select)}>
          <option value={info.task.id}>{fill(_("%(name)s (this task)"), { name: info.task.name })}</option>
          {others.map(({ id, name }) => <option key={id} value={id}>{name || id}</option>)}
        </select>
        <button type="button" className="btn btn-sm btn-primary"
          disabled={!this.state.others || this.state.busy === saved.id}
          onClick={() => this.act(saved.id, () => onAgain(saved, this.select.value, this.nameOf(this.select.value)))}>
          <Icon name="again" /> {_("Measure")}
        </button>
        <Button onClick={() => this.setState({ asking: null })}>{_("Cancel")}</Button>
      </div>
    );
  }
}
