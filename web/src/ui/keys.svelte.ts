import { speech } from "../i18n/index.svelte";
import { PLACES, route } from "./route.svelte";
import { theme } from "./theme.svelte";

/** Something a key does on the place that is shown. */
type Action = () => void;

class Keys {
  helpOpen = $state(false);
  private readonly actions = new Map<string, Action>();

  /** Give a key (as `KeyboardEvent.key`, lower case) a meaning until the returned function is called. */
  bind(key: string, action: Action): () => void {
    this.actions.set(key, action);
    return () => {
      if (this.actions.get(key) === action) this.actions.delete(key);
    };
  }

  press(key: string): boolean {
    const place = PLACES[Number(key) - 1];
    if (place) route.go(place);
    else if (key === "?") this.helpOpen = !this.helpOpen;
    else if (key === "t") theme.next();
    else if (key === "l") speech.toggle();
    else {
      const action = this.actions.get(key);
      action?.();
      return action !== undefined;
    }
    return true;
  }
}

export const keys = new Keys();

/** Keys work wherever no text is being typed and no control would use the key itself. */
export function handleKey(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  const target = event.target as HTMLElement | null;
  if (target?.closest("input, select, textarea, dialog, [contenteditable]")) return;
  if (event.key === " " && target?.closest("button, a, summary")) return;
  if (keys.press(event.key.length === 1 ? event.key.toLowerCase() : event.key)) event.preventDefault();
}
