export const PLACES = ["live", "sensors", "estimators", "calibrate", "logs", "board"] as const;
export type Place = (typeof PLACES)[number];

/** The place a path names; anything else is the start. */
export function placeOf(path: string): Place {
  const last = path.replace(/\/+$/, "").split("/").pop() ?? "";
  return PLACES.find((place) => place === last) ?? "live";
}

class Route {
  place = $state<Place>(typeof location === "undefined" ? "live" : placeOf(location.pathname));

  constructor() {
    if (typeof addEventListener === "function") {
      addEventListener("popstate", () => (this.place = placeOf(location.pathname)));
    }
  }

  /** Relative, so that the page also works below a path prefix. */
  href(place: Place): string {
    return `./${place}`;
  }

  go(place: Place): void {
    if (place === this.place && placeOf(location.pathname) === place) return;
    history.pushState(null, "", this.href(place));
    this.place = place;
  }
}

export const route = new Route();
