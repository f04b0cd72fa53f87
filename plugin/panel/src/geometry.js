// Outlines in longitude and latitude: their size on the ground, their faults, GeoJSON in and out.
// A ring here is a list of [lon, lat] without the repeated last point.

import { _, fill } from "./gettext";

const RADIUS_M = 6371008.8;
const RAD = Math.PI / 180;
const LONLAT_CRS = /(CRS84|EPSG:{1,2}4326|:4326)$/i;

/** Metres east and north of the ring's first point; good for sites, not for continents. */
function local(ring) {
  const [lon0, lat0] = ring[0];
  const east = RADIUS_M * Math.cos(lat0 * RAD) * RAD;
  return ring.map(([lon, lat]) => [(lon - lon0) * east, (lat - lat0) * RADIUS_M * RAD]);
}

export function ringArea(ring) {
  if (ring.length < 3) return 0;
  let twice = 0;
  const points = local(ring);
  points.forEach(([x, y], i) => {
    const [nextX, nextY] = points[(i + 1) % points.length];
    twice += x * nextY - nextX * y;
  });
  return Math.abs(twice) / 2;
}

/** The area of an outline less its holes, in square metres. */
export function polygonArea(rings) {
  return rings.slice(1).reduce((area, hole) => area - ringArea(hole), rings.length ? ringArea(rings[0]) : 0);
}

export function distance([lonA, latA], [lonB, latB]) {
  const h = Math.sin((latB - latA) * RAD / 2) ** 2 +
    Math.cos(latA * RAD) * Math.cos(latB * RAD) * Math.sin((lonB - lonA) * RAD / 2) ** 2;
  return 2 * RADIUS_M * Math.asin(Math.sqrt(h));
}

function side(a, b, c) {
  return Math.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
}

function segmentsCross(a, b, c, d) {
  return side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
}

function edges(ring) {
  return ring.map((point, i) => [point, ring[(i + 1) % ring.length]]);
}

function ringsCross(one, other) {
  return edges(one).some(([a, b]) => edges(other).some(([c, d]) => segmentsCross(a, b, c, d)));
}

function inside([x, y], ring) {
  let within = false;
  edges(ring).forEach(([[x1, y1], [x2, y2]]) => {
    if (y1 > y !== y2 > y && x < (x2 - x1) * (y - y1) / (y2 - y1) + x1) within = !within;
  });
  return within;
}

/** What is wrong with an outline and its holes, in words; null when nothing is. */
export function fault(rings) {
  if (rings.some((ring) => ring.length < 3)) return _("An outline needs at least three points.");
  if (rings.reduce((n, ring) => n + ring.length, 0) > 800) return null; // left to the server
  if (rings.some((ring) => ringsCross(ring, ring))) {
    return _("The outline crosses itself: drag the points apart, or undo.");
  }
  const [outer, ...holes] = rings;
  if (holes.some((hole) => ringsCross(outer, hole) || !inside(hole[0], outer))) {
    return _("A hole reaches out of its area: drag its points inside, or undo.");
  }
  return null;
}

/** Areas, [{name, rings, found}], as GeoJSON. An outline that was found and then edited is a drawn one. */
export function toGeoJSON(areas) {
  return {
    type: "FeatureCollection",
    features: areas.map(({ name, rings, found }) => ({
      type: "Feature",
      properties: propertiesOf(name, found && found.outline === JSON.stringify(rings) ? found.pile : null),
      geometry: { type: "Polygon", coordinates: rings.map((ring) => [...ring, ring[0]]) },
    })),
  };
}

/**
 * The polygons of a GeoJSON object as areas, [{name, rings, found}]; "area-1" is what has no name.
 * `found` says of a pile that nobody drew what is known of it, and its outline as it was found.
 */
export function toAreas(geojson) {
  return featuresOf(geojson).flatMap(({ name, pile, geometry }) => {
    const parts = geometry.type === "Polygon" ? [geometry.coordinates] : geometry.coordinates;
    return parts.map((part) => {
      const rings = part.map((ring) => ring.slice(0, -1).map(([lon, lat]) => [lon, lat]));
      const area = { name: /^area-\d+$/.test(name) ? "" : name, rings };
      const found = pile && parts.length === 1 ? { pile, outline: JSON.stringify(rings) } : null;
      return found ? { ...area, found } : area;
    });
  });
}

function propertiesOf(name, pile) {
  return { ...(name ? { name } : {}), ...pile };
}

function featuresOf(geojson) {
  if (geojson.type === "FeatureCollection") return (geojson.features || []).flatMap(featuresOf);
  if (geojson.type === "Feature") {
    const { name, kind, proposed, height_m, outline_std_m3 } = geojson.properties || {};
    // Of what was found besides piles, and of outlines that were only proposed, nothing is measured.
    if (proposed && kind !== "pile") return [];
    const said = {
      name: typeof name === "string" ? name : "",
      pile: proposed ? { proposed, kind, height_m, outline_std_m3 } : null,
    };
    return geojson.geometry ? featuresOf(geojson.geometry).map((f) => ({ ...f, ...said })) : [];
  }
  if (geojson.type === "GeometryCollection") return (geojson.geometries || []).flatMap(featuresOf);
  const isArea = geojson.type === "Polygon" || geojson.type === "MultiPolygon";
  return isArea ? [{ name: "", geometry: geojson }] : [];
}

/** Read a file of areas; throws an Error that says what to do. Returns {geojson, count, vertices}. */
export function readAreas(text, limits) {
  const bytes = new Blob([text]).size;
  if (limits && limits.area_bytes && bytes > limits.area_bytes) {
    throw new Error(fill(_("The file has %(found)s kB; the server takes %(limit)s kB. Simplify the outlines."),
      { found: Math.ceil(bytes / 1000), limit: Math.floor(limits.area_bytes / 1000) }));
  }
  let parsed;
  try {
    parsed = JSON.parse(text.replace(/^\uFEFF/, ""));
  } catch (e) {
    throw new Error(_("This is no GeoJSON file. Save the areas as GeoJSON (RFC 7946) and choose it again."));
  }
  const crs = parsed && parsed.crs && parsed.crs.properties && parsed.crs.properties.name;
  if (crs && !LONLAT_CRS.test(String(crs))) {
    throw new Error(fill(_("The file's coordinates are in %(crs)s. Save it in longitude and latitude " +
      "(WGS 84, EPSG:4326) and choose it again."), { crs: String(crs).slice(0, 60) }));
  }
  const features = parsed && typeof parsed === "object" ? featuresOf(parsed) : [];
  if (!features.length) {
    throw new Error(_("The file holds no polygon. Lines and points enclose no volume: draw areas."));
  }
  const geojson = {
    type: "FeatureCollection",
    features: features.map(({ name, pile, geometry: { type, coordinates } }) => ({
      type: "Feature",
      properties: propertiesOf(name, pile),
      geometry: { type, coordinates },
    })),
  };
  const vertices = checkedVertices(features);
  if (limits && limits.vertices && vertices > limits.vertices) {
    throw new Error(fill(_("The file has %(found)s vertices; the server takes %(limit)s. Simplify the outlines."),
      { found: vertices, limit: limits.vertices }));
  }
  return { geojson, count: features.length, vertices };
}

function checkedVertices(features) {
  let vertices = 0;
  features.forEach(({ geometry: { type, coordinates } }) => {
    const parts = type === "Polygon" ? [coordinates] : coordinates;
    const rings = Array.isArray(parts) ? parts.flat() : [];
    if (!rings.length || !rings.every((ring) => Array.isArray(ring) && ring.length >= 4)) {
      throw new Error(_("A polygon in the file has too few points. Mend it and choose the file again."));
    }
    rings.flat().forEach((point) => {
      const sound = Array.isArray(point) && point.slice(0, 2).every((v) => typeof v === "number") &&
        Math.abs(point[0]) <= 180 && Math.abs(point[1]) <= 90;
      if (!sound) {
        throw new Error(_("The file's coordinates are not longitude and latitude. Save it in WGS 84 " +
          "(EPSG:4326) and choose it again."));
      }
      vertices += 1;
    });
  });
  return vertices;
}
