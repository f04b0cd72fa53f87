// What a list whose rows can be acted on needs: what is asked about, what is busy, what went wrong.

import React from "React";
import { _ } from "./gettext";
import { Button, Notice } from "./ui";

export class Acting extends React.Component {
  state = { asking: null, busy: null, error: null };

  componentDidMount() {
    this.alive = true;
  }

  componentWillUnmount() {
    this.alive = false;
  }

  /** Do something with one of them, and show what goes wrong beside it. */
  act(id, doing) {
    this.setState({ busy: id, error: null });
    doing().then(
      () => this.alive && this.setState({ busy: null, asking: null }),
      (error) => this.alive && this.setState({ busy: null, error: { id, words: error.message } }),
    );
  }

  renderError(id) {
    const { error } = this.state;
    return error && error.id === id ? <Notice kind="error">{error.words}</Notice> : null;
  }

  /** Ask before something is gone. */
  renderAsk(id, { question, yes, no, doing }) {
    return (
      <div className="vc-ask" role="group" aria-label={yes}>
        <span>{question}</span>
        <button type="button" className="btn btn-sm btn-danger" disabled={this.state.busy === id}
          onClick={() => this.act(id, doing)}>
          {yes}
        </button>
        <Button onClick={() => this.setState({ asking: null })}>{no}</Button>
      </div>
    );
  }
}

/** What is asked before a result is dropped that is not saved. */
export function askDrop() {
  return { question: _("Drop this result? It is not saved, and cannot be brought back."), yes: _("Drop"), no: _("Keep") };
}
