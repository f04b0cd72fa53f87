// The panel: which task, which view, and the job under way. What is drawn and typed is kept here,
// so that it survives looking at something else.

import React from "React";
import { ScaleBars } from "./bars";
import { TaskApi } from "./api";
import { AreaEditor } from "./draw";
import { EMPTY_FORM, fromOptions, inUnits, toControl, toOptions } from "./form";
import { _, fill } from "./gettext";
import { rememberedJob, rememberJob, watchJob } from "./jobs";
import { isInView, lookAt, showResult } from "./layers";
import MeasureForm from "./MeasureForm";
import Progress from "./Progress";
import Result from "./Result";
import Saved from "./Saved";
import Series from "./Series";
import Tabs from "./Tabs";
import { onUnitsChanged, unitSystem } from "./units";
import { IconButton, Notice, Select, Spinner } from "./ui";

const FRESH = { view: "measure", form: EMPTY_FORM, info: null, job: null, result: null, error: null, list: null };

export default class Panel extends React.Component {
  state = { ...FRESH, taskId: this.props.tasks[0].id, units: unitSystem() };

  editor = new AreaEditor(this.props.map, () => this.forceUpdate());

  bars = new ScaleBars(this.props.map, () => this.forceUpdate());

  componentDidMount() {
    this.stopUnits = onUnitsChanged((units) => {
      const form = inUnits(this.state.form, this.state.units, units);
      this.bars.convert(units.perMetre / this.state.units.perMetre);
      this.setState({ units, form });
    });
    this.openTask(this.state.taskId);
    this.showTools();
  }

  componentDidUpdate(before, { view, job }) {
    // What had the focus may be gone with its view; Escape is to work all the same.
    const turned = view !== this.state.view || Boolean(job) !== Boolean(this.state.job);
    if (turned && this.props.shown && document.activeElement === document.body) this.focus();
    if (this.props.shown && !before.shown && this.state.info) this.loadList();
    this.showTools();
  }

  componentWillUnmount() {
    this.stopUnits();
    this.stopWatching();
    this.api = null;
    this.hideLayers();
    this.editor.destroy();
    this.bars.destroy();
  }

  /** The tools are on the map while their step is on the screen. */
  showTools() {
    const { view, form, job, info } = this.state;
    const filling = this.props.shown && view === "measure" && !job && Boolean(info) && info.can_run;
    const area = form.shape === "object" ? "whole" : form.area;
    this.editor.show(filling && (area === "draw" || area === "file"));
    this.bars.show(filling && form.control === "bars");
  }

  focus() {
    if (this.root) this.root.focus({ preventScroll: true });
  }

  get task() {
    return this.props.tasks.find((task) => task.id === this.state.taskId);
  }

  // Opening a task.

  openTask(taskId) {
    this.api = new TaskApi(taskId);
    const { api } = this;
    api.info().then(
      (info) => {
        if (api !== this.api) return;
        this.setState({ info, view: info.can_run ? "measure" : "saved", form: this.begun(info) });
        this.takeUpJob(info);
      },
      (error) => api === this.api && this.setState({ error: error.message }),
    );
    this.loadList();
  }

  /** A task that nothing can be drawn on begins with its whole cloud. */
  begun(info) {
    return info.has_crs ? this.state.form : { ...this.state.form, area: "whole" };
  }

  loadList = () => {
    const { api } = this;
    return api.list().then(
      (list) => api === this.api && this.setState({ list }),
      (error) => api === this.api && this.setState({ list: [], error: error.message }),
    );
  };

  chooseTask = (taskId) => {
    this.stopWatching();
    this.hideLayers();
    this.setState({ ...FRESH, form: this.state.form, taskId }, () => this.openTask(taskId));
  };

  takeUpJob(info) {
    const going = (info.jobs || []).slice(-1)[0];
    const id = going ? going.job : rememberedJob(info.task.id);
    if (id) this.watch(info.task.id, id, { remembered: !going });
  }

  // Measuring.

  measure = () => {
    const { form, units, info } = this.state;
    const area = form.shape === "object" ? "whole" : form.area;
    const drawn = area === "draw" || (area === "file" && this.editor.areas.length);
    let asked = drawn ? this.editor.toGeoJSON() : area;
    if (area === "file" && !drawn) asked = form.file.geojson;
    const { api } = this;
    this.againName = null;
    this.setState({ error: null, job: { task: info.task.id, state: "sending" } });
    api.start(asked, toOptions(form, units), toControl(form, this.bars.bars, units)).then(
      ({ job }) => {
        // Of a task that was left meanwhile: found again with it.
        if (api !== this.api) rememberJob(info.task.id, job);
        else this.watch(info.task.id, job);
      },
      (error) => api === this.api && this.setState({ job: null, error: error.message }),
    );
  };

  again = (saved, task) => {
    const here = this.api;
    this.setState({ error: null });
    return here.again(saved.id, task).then(
      (started) => {
        if (here !== this.api) return;
        this.againName = saved.name;
        this.watch(started.task || this.state.taskId, started.job);
      },
      (error) => this.setState({ error: error.message }),
    );
  };

  watch(task, id, how) {
    this.stopWatching();
    const api = task === this.state.taskId ? this.api : new TaskApi(task);
    rememberJob(task, id);
    this.setState({ view: "measure", result: null, job: { task, job: id, state: "queued" } });
    this.unwatch = watchJob(api, id, (state) => this.told(api, state), how);
  }

  told(api, state) {
    const job = { ...this.state.job, ...state, unreachable: state.unreachable || null };
    if (state.state === "done") {
      this.fetchResult(api, state.job);
    } else if (state.state === "failed" || state.state === "cancelled") {
      rememberJob(api.taskId, null);
      const words = state.forgotten ? null : state.error || _("The measurement failed. The server's log says why.");
      this.setState({ job: null, error: state.state === "failed" ? words : null });
      return;
    }
    this.setState({ job });
  }

  fetchResult(api, id) {
    const here = this.api;
    api.result(id).then(
      (doc) => {
        if (here !== this.api) return;
        this.setState({ job: null });
        const failures = doc.measurement.results.map(({ error }) => error);
        if (failures.every(Boolean)) {
          // Nothing to look at: back to what was drawn.
          rememberJob(api.taskId, null);
          this.setState({ error: [...new Set(failures)].join(" ") });
          return;
        }
        this.showDocument(doc, { job: id, task: api.taskId });
      },
      (error) => {
        rememberJob(api.taskId, null);
        if (here === this.api) this.setState({ job: null, error: error.message });
      },
    );
  }

  cancel = () => {
    const { job } = this.state;
    this.stopWatching();
    this.setState({ job: { ...job, state: "cancelling" } });
    const api = new TaskApi(job.task);
    const ended = () => {
      rememberJob(job.task, null);
      this.setState({ job: null });
    };
    api.cancel(job.job).then(ended, (error) => {
      ended();
      this.setState({ error: error.message });
    });
  };

  stopWatching() {
    if (this.unwatch) this.unwatch();
    this.unwatch = null;
  }

  // A result, new or saved.

  /** `unsaved` tells of which job it is; null for what is among the task's files. */
  showDocument(doc, unsaved) {
    this.hideLayers();
    this.shownLayers = showResult(this.props.map, this.task, doc);
    // What was just drawn is in view; what was saved once may lie anywhere.
    if (!unsaved && !isInView(this.props.map, this.shownLayers.bounds)) {
      lookAt(this.props.map, this.shownLayers.bounds);
    }
    this.setState({ view: "result", result: { doc, unsaved }, error: null });
  }

  hideLayers() {
    if (this.shownLayers) this.shownLayers.remove();
    this.shownLayers = null;
  }

  save = (name) => {
    const { job, task } = this.state.result.unsaved;
    return new TaskApi(task).save(job, name).then((doc) => {
      rememberJob(task, null);
      if (this.shownLayers) this.shownLayers.rename(doc.name);
      this.setState({ result: { doc, unsaved: null } });
      this.loadList();
    });
  };

  rename = (doc, name) => new TaskApi(doc.task || this.state.taskId).rename(doc.id, name).then((renamed) => {
    const { result } = this.state;
    if (result && result.doc.id === doc.id) {
      if (this.shownLayers) this.shownLayers.rename(renamed.name);
      this.setState({ result: { ...result, doc: { ...result.doc, name: renamed.name } } });
    }
    return this.loadList();
  });

  remove = (saved) => this.api.remove(saved.id).then(() => {
    const { result } = this.state;
    if (result && result.doc.id === saved.id) {
      this.hideLayers();
      this.setState({ result: null });
    }
    return this.loadList();
  });

  open = (id, taskId = this.state.taskId) => {
    const api = taskId === this.state.taskId ? this.api : new TaskApi(taskId);
    const here = this.api;
    this.setState({ error: null });
    return api.saved(id).then(
      (doc) => here === this.api && this.showDocument(doc, null),
      (error) => here === this.api && this.setState({ error: error.message }),
    );
  };

  /** Leave a result; its job is no longer taken up after a reload. */
  newMeasurement = () => {
    const { unsaved } = this.state.result || {};
    if (unsaved) rememberJob(unsaved.task, null);
    this.hideLayers();
    this.setState({ view: "measure", result: null });
  };

  /** Take the area and the settings of a measurement into the form. */
  edit = (doc) => {
    const form = fromOptions(doc.options || {}, this.state.units);
    this.hideLayers();
    if (doc.area) this.editor.load(doc.area);
    this.setState({ view: "measure", result: null, form: { ...form, area: doc.area ? "draw" : "whole" } });
  };

  // What is on the screen.

  keyed = (event) => {
    if (event.key !== "Escape" || event.defaultPrevented) return;
    if (this.editor.drawing) this.editor.stopDrawing();
    else if (this.bars.picking) this.bars.stop();
    else this.props.onClose();
  };

  render() {
    const { tasks, onClose } = this.props;
    const { error, info, taskId } = this.state;
    const onMap = `${this.editor.drawing || this.bars.picking ? " vc-on-map" : ""}${this.bars.picking ? " vc-picking" : ""}`;
    return (
      <div className={`volcalc-panel theme-secondary theme-color-primary${onMap}`} tabIndex={-1}
        role="dialog" aria-labelledby="volcalc-title" ref={(root) => (this.root = root)} onKeyDown={this.keyed}>
        <div className="vc-head">
          <h4 id="volcalc-title">{_("Volume (VolCalc)")}</h4>
          <IconButton icon="close" label={_("Close")} onClick={onClose} />
          {tasks.length > 1 ? (
            <Select label={_("Task")} value={taskId} onChange={this.chooseTask}
              options={tasks.map(({ id, name }) => ({ key: id, text: name || id }))} />
          ) : null}
          {info ? this.renderTabs() : null}
        </div>
        {error ? (
          <div className="vc-errors">
            <Notice kind="error" onClose={() => this.setState({ error: null })}>{error}</Notice>
          </div>
        ) : null}
        <div className="vc-view" role={info ? "tabpanel" : null}>{info ? this.renderView() : this.renderWaiting()}</div>
      </div>
    );
  }

  renderWaiting() {
    if (!this.state.error) return <p className="vc-body vc-quiet"><Spinner /> {_("Looking at the task …")}</p>;
    return (
      <p className="vc-body">
        <button type="button" className="btn btn-sm btn-primary"
          onClick={() => this.setState({ error: null }, () => this.openTask(this.state.taskId))}>
          {_("Try again")}
        </button>
      </p>
    );
  }

  renderTabs() {
    const { view, list, result, job } = this.state;
    const shown = view === "result" ? (result && result.unsaved ? "measure" : "saved") : view;
    return <Tabs shown={shown} saved={list ? list.length : 0} busy={Boolean(job)} onTurn={(next) => this.turnTo(next)} />;
  }

  turnTo(view) {
    const { result } = this.state;
    const back = view === "measure" && result && result.unsaved;
    if (!back && result && !result.unsaved) this.hideLayers();
    this.setState({ view: back ? "result" : view, result: result && result.unsaved ? result : null });
  }

  renderView() {
    const { view, info, job, form, units, list, result } = this.state;
    if (view === "saved") {
      return (
        <Saved list={list} info={info} units={units} api={this.api} onOpen={this.open} onRename={this.rename}
          onRemove={this.remove} onAgain={this.again} tasks={this.props.tasks} />
      );
    }
    if (view === "series") {
      return <Series api={this.api} units={units} project={info.task.project} onOpen={this.open} />;
    }
    if (view === "result" && result) {
      return (
        <Result key={result.doc.id} doc={result.doc} unsaved={result.unsaved} info={info} units={units}
          api={new TaskApi(result.doc.task || info.task.id)} suggested={this.suggestedName()}
          onSave={this.save} onRename={this.rename} onNew={this.newMeasurement} onEdit={this.edit}
          onBack={() => this.turnTo("saved")} />
      );
    }
    if (job) {
      return <Progress job={job} onCancel={this.cancel} onAgain={() => this.leaveLost()} />;
    }
    return (
      <MeasureForm info={info} form={form} units={units} editor={this.editor} bars={this.bars} map={this.props.map}
        onChange={(change) => this.setState((state) => ({ form: { ...state.form, ...change } }))}
        onMeasure={this.measure} onError={(error) => this.setState({ error })} />
    );
  }

  /** A lost job is left behind, and the form is as it was. */
  leaveLost() {
    this.stopWatching();
    rememberJob(this.state.job.task, null);
    new TaskApi(this.state.job.task).cancel(this.state.job.job).catch(() => {});
    this.setState({ job: null });
  }

  suggestedName() {
    const { list, result } = this.state;
    if (this.againName) return this.againName;
    const [first] = result.doc.measurement.results;
    const drawn = first && !/^area-\d+$/.test(first.name) ? first.name : "";
    return drawn || fill(_("Measurement %(number)s"), { number: (list || []).length + 1 });
  }
}
