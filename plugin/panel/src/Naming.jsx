// Giving a name: to what is being saved, and to what is saved.

import React from "React";
import { _ } from "./gettext";
import { Button, Icon, IconButton, Spinner } from "./ui";

const LONGEST = 80;

export class NameField extends React.Component {
  state = { name: this.props.suggested };

  save = (event) => {
    event.preventDefault();
    if (this.state.name.trim() && !this.props.busy) this.props.onSave(this.state.name.trim());
  };

  render() {
    const { busy } = this.props;
    return (
      <form className="vc-naming" onSubmit={this.save}>
        <input className="form-control" aria-label={_("Name of the measurement")} value={this.state.name}
          maxLength={LONGEST} onChange={(event) => this.setState({ name: event.target.value })}
          onFocus={(event) => event.target.select()} />
        <button type="submit" className="btn btn-sm btn-primary" disabled={busy || !this.state.name.trim()}>
          {busy ? <Spinner /> : null} {_("Save")}
        </button>
      </form>
    );
  }
}

export class Rename extends React.Component {
  state = { typing: null, error: null };

  save = (event) => {
    event.preventDefault();
    const name = this.state.typing.trim();
    if (!name || name === this.props.name) {
      this.setState({ typing: null });
      return;
    }
    this.props.onRename(name).then(
      () => this.setState({ typing: null, error: null }),
      (error) => this.setState({ error: error.message }),
    );
  };

  keyed = (event) => {
    if (event.key !== "Escape") return;
    event.preventDefault();
    this.setState({ typing: null, error: null });
  };

  render() {
    const { name, may, children } = this.props;
    const { typing, error } = this.state;
    if (typing === null) {
      return (
        <div className="vc-name">
          {children || <strong>{name}</strong>}
          {may ? <IconButton icon="pencil" label={_("Rename")} onClick={() => this.setState({ typing: name })} /> : null}
        </div>
      );
    }
    return (
      <form className="vc-naming" onSubmit={this.save} onKeyDown={this.keyed}>
        <input className="form-control" autoFocus value={typing} maxLength={LONGEST} aria-label={_("New name")}
          onChange={(event) => this.setState({ typing: event.target.value })} />
        <Button onClick={this.save} primary><Icon name="ok" /> {_("Rename")}</Button>
        {error ? <div className="vc-said vc-said-wrong" role="alert">{error}</div> : null}
      </form>
    );
  }
}
