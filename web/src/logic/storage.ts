/** What a person chose on this browser; works without storage (private windows), then only until reload. */
const PREFIX = "navdeck.";

export function recall(name: string, otherwise: string): string {
  try {
    return localStorage.getItem(PREFIX + name) ?? otherwise;
  } catch {
    return otherwise;
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // Private windows may refuse; the choice then lasts until reload.
  }
}

export function recallJson<T>(name: string, otherwise: T, isValid: (value: unknown) => value is T): T {
  try {
    const value: unknown = JSON.parse(recall(name, "null"));
    return isValid(value) ? value : otherwise;
  } catch {
    return otherwise;
  }
}
