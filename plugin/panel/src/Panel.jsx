// The panel: which task, which view, and the measurements under way. What is drawn and typed is kept
// here, so that it survives looking at something else. Without a map (the 3-D view) nothing is drawn.

import React from "React";
import { ScaleBars } from "./bars";
import { READING, TaskApi } from "./api";
import { AreaEditor } from "./draw";
import { EMPTY_FORM, fromDocument, inUnits, toControl, toOptions, withBase } from "./form";
import { _, fill } from "./gettext";
import { MyJobs } from "./jobs";
import { isInView, lookAt, showResult } from "./layers";
import MeasureForm from "./MeasureForm";
import Mine from "./Mine";
import Progress from "./Progress";
import Result from "./Result";
import Saved from "./Saved";
import Series from "./Series";
import Tabs from "./Tabs";
import { onUnitsChanged, unitSystem } from "./units";
import { IconButton, Notice, Select, Spinner } from "./ui";

const FRESH = { view: "measure", form: EMPTY_FORM, info: null, sending: false, result: null, error: null, list: null };

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

  componentDidUpdate(before) {
    // What had the focus may be gone with its view; Escape is to work all the same.
    const step = `${this.state.view} ${Boolean(this.job)}`;
    if (step !== this.step && this.props.shown && document.activeElement === document.body) this.focus();
    this.step = step;
    if (this.mine && this.state.info) this.mine.show(this.props.shown);
    if (this.props.shown && !before.shown && this.state.info) this.loadList();
    this.showTools();
  }

  componentWillUnmount() {
    this.stopUnits();
    this.mine.destroy();
    this.api = null;
    clearTimeout(this.reading);
    this.hideLayers();
    this.editor.destroy();
    this.bars.destroy();
  }

  /** The tools are on the map while their step is on the screen. */
  showTools() {
    if (!this.props.map) return;
    const { view, form, info } = this.state;
    const filling = this.props.shown && view === "measure" && !this.job && Boolean(info) && info.can_run;
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

  /** The measurement whose progress is on the screen. */
  get job() {
    return this.state.sending ? { state: "sending" } : this.mine && this.mine.find(this.mine.followed);
  }

  /** The visitor's own that are not among the saved ones. */
  get unsaved() {
    return this.mine.rows.filter(({ saved }) => !saved);
  }

  // Opening a task.

  openTask(taskId) {
    if (this.mine) this.mine.destroy();
    this.api = new TaskApi(taskId);
    const { api } = this;
    const mine = new MyJobs(api, () => mine === this.mine && this.heard(), this.ended);
    this.mine = mine;
    this.savedJobs = null;
    api.info().then(
      (info) => {
        if (api !== this.api) return;
        const view = info.can_run || info.jobs.length ? "measure" : "saved";
        this.setState({ info, view, form: this.begun(info) }, () => mine.begin(info.jobs, this.props.shown));
      },
      (error) => api === this.api && this.setState({ error: error.message }),
    );
    this.loadList();
  }

  /** A task that nothing can be drawn on begins with its whole cloud. */
  begun(info) {
    const form = withBase(this.state.form, info);
    return info.has_crs && this.props.map ? form : { ...form, area: "whole" };
  }

  loadList = (times = READING.times) => {
    const { api } = this;
    clearTimeout(this.reading);
    return api.list().then(
      (list) => api === this.api && this.listed(list, times),
      (error) => api === this.api && this.setState({ list: [], error: error.message }),
    );
  };

  /** What one answer leaves unread the next ones tell; another process of the server may know less. */
  listed(list, times) {
    const known = new Map((this.state.list || []).map((row) => [row.id, row]));
    const rows = list.map((row) => (row.unread && known.get(row.id)) || row);
    this.setState({ list: rows });
    if (times && rows.some(({ unread }) => unread)) this.reading = setTimeout(this.loadList, READING.pause, times - 1);
  }

  chooseTask = (taskId) => {
    this.hideLayers();
    this.setState({ ...FRESH, form: this.state.form, taskId }, () => this.openTask(taskId));
  };

  // Measuring.

  measure = () => {
    const { form, units, info } = this.state;
    const area = form.shape === "object" ? "whole" : form.area;
    const drawn = area === "draw" || (area === "file" && this.editor.areas.length);
    let asked = drawn ? this.editor.toGeoJSON() : area;
    if (area === "file" && !drawn) asked = form.file.geojson;
    const { api } = this;
    const name = this.newName(drawn);
    this.setState({ error: null, sending: true });
    // Of a task that was left meanwhile: the server has it, and tells of it there.
    api.start(asked, toOptions(form, units), toControl(form, this.bars.bars, units), name).then(
      ({ job }) => api === this.api && this.begin({ job, task: info.task.id, name }),
      (error) => api === this.api && this.setState({ sending: false, error: error.message }),
    );
  };

  begin(started) {
    this.mine.start(started);
    this.setState({ view: "measure", result: null, sending: false, error: null });
  }

  again = (saved, task, taskName) => {
    const here = this.api;
    this.setState({ error: null });
    return here.again(saved.id, task).then(
      (started) => here === this.api &&
        this.begin({ job: started.job, task: started.task || here.taskId, taskName, name: saved.name }),
      (error) => this.setState({ error: error.message }),
    );
  };

  /** The same once more, in the place of one that came to nothing. */
  startAgain = (row) => new TaskApi(row.task).startAgain(row.job).then(({ job }) => {
    this.mine.rows = this.mine.rows.filter((other) => other.job !== row.job);
    this.begin({ ...row, job });
  });

  /** Something has changed among the visitor's own, here or in another window. */
  heard() {
    const saved = this.mine.rows.filter((row) => row.saved).map(({ job }) => job).join();
    if (this.savedJobs !== null && saved !== this.savedJobs) this.loadList();
    this.savedJobs = saved;
    const { result } = this.state;
    const row = result && result.unsaved && this.mine.find(result.unsaved.job);
    if (row && row.saved) this.open(row.job, row.task);
    this.forceUpdate();
  }

  ended = ({ state, job, task }) => {
    if (state === "done" && this.state.view === "measure") {
      this.openOwn({ job, task }).catch((error) => this.setState({ error: error.message }));
    } else if (state === "gone") {
      this.setState({
        error: _("The server no longer knows this measurement: it was dropped in another window, the plugin was " +
          "replaced, or you are no longer logged in. Reload the page, and measure again."),
      });
    }
  };

  /** Show what one of the visitor's own came to. */
  openOwn = ({ job, task }) => {
    const here = this.api;
    return new TaskApi(task).result(job).then((doc) => {
      if (here !== this.api) return;
      const failures = doc.measurement.results.map(({ error }) => error);
      // Nothing to look at: back to what was drawn.
      if (failures.every(Boolean)) this.setState({ error: [...new Set(failures)].join(" ") });
      else this.showDocument(doc, { job, task });
    });
  };

  // A result, new or saved.

  /** `unsaved` tells of which job it is; null for what is among the task's files. */
  showDocument(doc, unsaved) {
    const { map } = this.props;
    this.hideLayers();
    if (map) this.shownLayers = showResult(map, this.task, doc);
    // What was just drawn is in view; what was found, or saved once, may lie anywhere.
    if (map && !isInView(map, this.shownLayers.bounds)) lookAt(map, this.shownLayers.bounds);
    this.setState({ view: "result", result: { doc, unsaved }, error: null });
  }

  hideLayers() {
    if (this.shownLayers) this.shownLayers.remove();
    this.shownLayers = null;
  }

  save = (name) => {
    const { job, task } = this.state.result.unsaved;
    return new TaskApi(task).save(job, name).then((doc) => {
      if (this.shownLayers) this.shownLayers.rename(doc.name);
      this.setState({ result: { doc, unsaved: null } });
      this.mine.ask();
    });
  };

  saveOwn = ({ job, task, name }) => new TaskApi(task).save(job, name).then(() => this.mine.ask());

  dropShown = () => this.mine.drop(this.state.result.unsaved).then(this.newMeasurement);

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
    // Who deletes what he measured himself wants no copy of it among his unsaved ones either.
    const row = this.mine.find(saved.id);
    if (row) this.mine.drop(row).catch(() => {});
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

  /** Leave a result; one that is not saved stays among the visitor's own. */
  newMeasurement = () => {
    this.hideLayers();
    this.setState({ view: "measure", result: null });
  };

  /** Measure again with the outline that a result proposes; with control there is more to be given. */
  takeProposal = (doc, index) => {
    const drawn = doc.area || { type: "FeatureCollection", features: [] };
    const features = [...drawn.features];
    const { geometry, properties } = doc.layers[index].proposal.features[0];
    features[index] = { type: "Feature", properties, ...features[index], geometry };
    this.edit({ ...doc, area: { ...drawn, features } }, doc.control ? undefined : this.measure);
  };

  /** Take the area and the settings of a measurement into the form. */
  edit = (doc, then) => {
    const { map } = this.props;
    const { info, units } = this.state;
    this.hideLayers();
    if (doc.area && map) this.editor.load(doc.area);
    this.setState({ view: "measure", result: null, form: withBase(fromDocument(doc, units, Boolean(map)), info) }, then);
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
          <h4 id="volcalc-title">
            {_("Volume (VolCalc)")} {info ? <small className="vc-version" title={_("Version and build")}>{info.version}</small> : null}
          </h4>
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
    const { view, list, result, sending } = this.state;
    const shown = view === "result" ? (result && result.unsaved ? "measure" : "saved") : view;
    return <Tabs shown={shown} saved={list ? list.length : 0} busy={sending || this.mine.busy} onTurn={(next) => this.turnTo(next)} />;
  }

  turnTo(view) {
    const { result } = this.state;
    const back = view === "measure" && result && result.unsaved;
    if (!back && result && !result.unsaved) this.hideLayers();
    this.setState({ view: back ? "result" : view, result: result && result.unsaved ? result : null });
  }

  renderView() {
    const { view, info, form, units, list, result } = this.state;
    const { map } = this.props;
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
        <Result key={result.doc.id} doc={result.doc} unsaved={result.unsaved} info={info} units={units} onMap={Boolean(map)}
          api={new TaskApi(result.doc.task || info.task.id)} own={result.unsaved && this.mine.find(result.unsaved.job)}
          onSave={this.save} onRename={this.rename} onNew={this.newMeasurement} onEdit={this.edit} onDrop={this.dropShown}
          onPropose={this.takeProposal} here={(result.doc.task || info.task.id) === info.task.id}
          onBack={() => this.turnTo("saved")} />
      );
    }
    const { job } = this;
    if (job) {
      return (
        <Progress key={job.job} job={job} limits={info.limits} problem={this.mine.problem} onCancel={() => this.mine.cancel(job)}
          onLeave={() => this.mine.follow(null)}>
          {this.renderMine(job.job)}
        </Progress>
      );
    }
    return (
      <MeasureForm info={info} form={form} units={units} editor={this.editor} bars={this.bars} map={map}
        onChange={(change) => this.setState((state) => ({ form: { ...state.form, ...change } }))}
        onMeasure={this.measure} onError={(error) => this.setState({ error })}>
        {this.renderMine(null)}
      </MeasureForm>
    );
  }

  renderMine(but) {
    const { info } = this.state;
    return (
      <Mine rows={this.unsaved.filter(({ job }) => job !== but)} info={info} limits={info.limits}
        problem={but ? null : this.mine.problem} onFollow={(job) => this.mine.follow(job)} onCancel={(row) => this.mine.cancel(row)}
        onOpen={this.openOwn} onSave={this.saveOwn} onDrop={(row) => this.mine.drop(row)} onAgain={this.startAgain} />
    );
  }

  /** What a new measurement is called until its owner names it: as its one area, or by a number. */
  newName(drawn) {
    const named = drawn && this.editor.areas.length === 1 && this.editor.areas[0].name.trim();
    const number = (this.state.list || []).length + this.unsaved.length + 1;
    return named || fill(_("Measurement %(number)s"), { number });
  }
}
