// Small parts that all views share.

import React from "React";
import { _ } from "./gettext";

const PATHS = {
  close: "M4 4l8 8M12 4l-8 8",
  draw: "M2.5 12.5l2-7 6.5-3 2.5 6.5-5 4.5z",
  file: "M4 1.5h5l3 3v10H4zM9 1.5v3h3",
  crop: "M4 1v11h11M1 4h11v11",
  find: "M10.5 10.5L14 14M6.5 2a4.5 4.5 0 110 9 4.5 4.5 0 010-9z",
  cloud: "M3 5h.01M8 3h.01M13 5h.01M5 8h.01M10.5 8h.01M3 12h.01M8 12.5h.01M13 11h.01",
  undo: "M6 3L2.5 6.5 6 10M3 6.5h6.5a3.5 3.5 0 010 7H7",
  plus: "M8 3v10M3 8h10",
  hole: "M2 3h12v10H2zM6 6.5h4v3H6z",
  trash: "M3 4.5h10M6.5 4.5V2.5h3v2M4.5 4.5l.6 9h5.8l.6-9",
  download: "M8 2v8M4.5 7L8 10.5 11.5 7M2.5 13.5h11",
  again: "M13 8a5 5 0 11-1.6-3.7M13 2v3h-3",
  pencil: "M3 13l.7-3L10.5 3.2l2.3 2.3L6 12.3z",
  show: "M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8zM8 6.2a1.8 1.8 0 100 3.6 1.8 1.8 0 000-3.6z",
  ok: "M3 8.5l3.5 3.5L13 4.5",
  back: "M10 3L5 8l5 5",
};

export function Icon({ name }) {
  return (
    <svg className="vc-icon" viewBox="0 0 16 16" aria-hidden="true" focusable="false">
      <path d={PATHS[name]} />
    </svg>
  );
}

export function Spinner() {
  return <span className="vc-spinner" aria-hidden="true" />;
}

/** A button that is an icon; its words are its name and its hint. */
export function IconButton({ icon, label, onClick, disabled, danger }) {
  return (
    <button type="button" className={`vc-icon-button${danger ? " vc-danger" : ""}`} title={label}
      aria-label={label} onClick={onClick} disabled={disabled}>
      <Icon name={icon} />
    </button>
  );
}

export function Button({ children, primary, small = true, ...rest }) {
  return (
    <button type="button" className={`btn ${small ? "btn-sm" : ""} ${primary ? "btn-primary" : "btn-secondary vc-plain"}`}
      {...rest}>
      {children}
    </button>
  );
}

/** One of a few, side by side; radio buttons for keyboard and screen reader. */
export function Choice({ name, label, value, options, onChange }) {
  return (
    <div className="vc-choice" role="radiogroup" aria-label={label}>
      {options.map(({ key, text, icon, disabled, hint }) => (
        <label key={key} className={`${value === key ? "vc-on" : ""}${disabled ? " vc-off" : ""}`} title={hint || ""}>
          <input type="radio" name={name} value={key} checked={value === key} disabled={disabled}
            onChange={() => onChange(key)} />
          {icon ? <Icon name={icon} /> : null}
          <span>{text}</span>
        </label>
      ))}
    </div>
  );
}

let fieldNumber = 0;

/** A label with its input; `unit` stands behind it, `wrong` says what to mend. */
export class Field extends React.Component {
  id = `volcalc-field-${(fieldNumber += 1)}`;

  render() {
    const { label, unit, hint, wrong, children, value, onChange, placeholder, short } = this.props;
    const input = children ? React.cloneElement(children, { id: this.id }) : (
      <input id={this.id} type="text" inputMode="decimal" autoComplete="off" placeholder={placeholder}
        className={`form-control${wrong ? " vc-wrong" : ""}`} value={value}
        aria-invalid={Boolean(wrong)} aria-describedby={`${this.id}-said`}
        onChange={(event) => onChange(event.target.value)} />
    );
    return (
      <div className={`vc-field${short ? " vc-short" : ""}`}>
        <label htmlFor={this.id}>{label}</label>
        <div className="vc-input">
          {input}
          {unit ? <span className="vc-unit">{unit}</span> : null}
        </div>
        <div id={`${this.id}-said`} className={wrong ? "vc-said vc-said-wrong" : "vc-said"}>{wrong || hint || null}</div>
      </div>
    );
  }
}

export function Select({ label, value, options, onChange, hint }) {
  return (
    <Field label={label} hint={hint}>
      <select className="form-control" value={value} onChange={(event) => onChange(event.target.value)}>
        {options.map(({ key, text, disabled }) => <option key={key} value={key} disabled={disabled}>{text}</option>)}
      </select>
    </Field>
  );
}

export function Check({ label, checked, onChange }) {
  return (
    <label className="vc-check">
      <input type="checkbox" checked={checked} onChange={(event) => onChange(event.target.checked)} />
      <span>{label}</span>
    </label>
  );
}

/** Something to know (`note`), to mind (`warning`) or to mend (`error`), in words. */
export function Notice({ kind = "note", children, onClose }) {
  return (
    <div className={`vc-notice vc-${kind}`} role={kind === "error" ? "alert" : "status"}>
      <div>{children}</div>
      {onClose ? <IconButton icon="close" label={_("Dismiss")} onClick={onClose} /> : null}
    </div>
  );
}

export function Fold({ title, said, open, onToggle, className = "", children }) {
  return (
    <details className={`vc-fold ${className}`} open={open} onToggle={(event) => onToggle && onToggle(event.target.open)}>
      <summary>
        <span>{title}</span>
        {said ? <span className="vc-fold-said">{said}</span> : null}
      </summary>
      <div className="vc-fold-body">{children}</div>
    </details>
  );
}

export function FilePick({ label, accept, onText, onError, limit }) {
  const chosen = (event) => {
    const file = event.target.files[0];
    event.target.value = "";
    if (!file) return;
    if (limit && file.size > limit) {
      onError(`${file.name}: ${_("the file is too large.")} (${Math.ceil(file.size / 1000)} kB, ` +
        `${_("at most")} ${Math.floor(limit / 1000)} kB)`);
      return;
    }
    const reader = new FileReader();
    reader.onload = () => onText(reader.result, file.name);
    reader.onerror = () => onError(`${file.name}: ${_("the file cannot be read. Choose it again.")}`);
    reader.readAsText(file);
  };
  return (
    <label className="btn btn-sm btn-secondary vc-plain vc-file">
      <Icon name="file" /> {label}
      <input type="file" accept={accept} onChange={chosen} />
    </label>
  );
}
