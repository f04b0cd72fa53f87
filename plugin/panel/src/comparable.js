// Which volumes of a series may be subtracted from each other. What they have to share is told by the
// server (`comparable`, docs/webodm.md): all of it.

/** The names of what two quantities differ in; none when their volumes may be subtracted. */
export function differences(one, other) {
  const names = [...new Set([...Object.keys(one), ...Object.keys(other)])];
  const apart = names.filter((name) => JSON.stringify(one[name]) !== JSON.stringify(other[name]));
  // Of a body and of terrain nothing is alike: the first says it all.
  return apart.includes("shape") ? ["shape"] : apart;
}

/**
 * The rows in the order of time, each with the last earlier row that it is compared with (`before`, null
 * without), and with what it differs in from the latest row (`apart`). One without a volume has neither.
 */
export function compared(rows) {
  const inTime = rows.slice().sort((a, b) => String(a.date).localeCompare(String(b.date)));
  const hasVolume = ({ volume_m3: volume }) => Number.isFinite(volume);
  const latest = inTime.filter(hasVolume).pop();
  return inTime.map((row, index) => {
    if (!hasVolume(row)) return { ...row, before: null, apart: [] };
    const earlier = inTime.slice(0, index).filter(hasVolume);
    const like = earlier.filter(({ comparable }) => !differences(comparable, row.comparable).length);
    return { ...row, before: like.pop() || null, apart: differences(row.comparable, latest.comparable) };
  });
}
