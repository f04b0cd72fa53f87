// Texts go through Django's catalogue, which every page of WebODM loads; msgids are English.

export function _(text) {
  return typeof window.gettext === "function" ? window.gettext(text) : text;
}

/** Put values into the places %(name)s of a translated text. */
export function fill(text, values) {
  return text.replace(/%\((\w+)\)s/g, (place, name) => (name in values ? String(values[name]) : place));
}
