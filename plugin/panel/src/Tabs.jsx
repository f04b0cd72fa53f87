// The three views of the panel, turned by a click or by the arrow keys.

import React from "React";
import { _ } from "./gettext";
import { Spinner } from "./ui";

export default function Tabs({ shown, saved, busy, onTurn }) {
  const count = saved ? ` (${saved})` : "";
  const tabs = [["measure", _("Measure")], ["saved", _("Saved") + count], ["series", _("Over time")]];
  const keys = tabs.map(([key]) => key);
  const turn = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = keys[(keys.indexOf(shown) + step + keys.length) % keys.length];
    onTurn(next);
    event.currentTarget.querySelector(`[data-tab="${next}"]`).focus();
  };
  return (
    <div className="vc-tabs" role="tablist" onKeyDown={turn}>
      {tabs.map(([key, text]) => (
        <button key={key} type="button" role="tab" data-tab={key} aria-selected={shown === key}
          tabIndex={shown === key ? 0 : -1} onClick={() => onTurn(key)}>
          {text}
          {key === "measure" && busy ? <Spinner /> : null}
        </button>
      ))}
    </div>
  );
}
