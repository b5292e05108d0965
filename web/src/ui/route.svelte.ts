export const PLACES = ["live", "sensors", "estimators", "calibrate", "logs", "board"] as const;
export type Place = (typeof PLACES)[number];

/** The place a path names; anything else is the start. */
export function placeOf(path: string): Place {
  const last = path.replace(/\/+$/, "").split("/").pop() ?? "";
  return PLACES.find((place) => place === last) ?? "live";
}

/** What of a place is open, in the address after the question mark. */
export type Query = Readonly<Record<string, string>>;

function queryOf(search: string): Query {
  return Object.fromEntries(new URLSearchParams(search));
}

class Route {
  place = $state<Place>(typeof location === "undefined" ? "live" : placeOf(location.pathname));
  query = $state.raw<Query>(typeof location === "undefined" ? {} : queryOf(location.search));

  constructor() {
    if (typeof addEventListener !== "function") return;
    addEventListener("popstate", () => {
      this.place = placeOf(location.pathname);
      this.query = queryOf(location.search);
    });
  }

  /** Relative, so that the page also works below a path prefix. */
  href(place: Place, query: Query = {}): string {
    const search = new URLSearchParams(query).toString();
    return `./${place}${search && `?${search}`}`;
  }

  go(place: Place, query: Query = {}): void {
    const next = this.href(place, query);
    if (next === this.href(this.place, this.query) && placeOf(location.pathname) === place) return;
    history.pushState(null, "", next);
    this.place = place;
    this.query = query;
  }

  /** Say more exactly what is open, without a step of its own on the way back. */
  refine(query: Query): void {
    history.replaceState(null, "", this.href(this.place, query));
    this.query = query;
  }
}

export const route = new Route();
