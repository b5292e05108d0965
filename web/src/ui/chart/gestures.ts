import { timeWindow } from "./window.svelte";

/** Wheel zooms about the pointer, dragging pans, two fingers zoom, a double click returns to now. */
export function gestures(target: HTMLElement, timeAtPointerS: () => number): () => void {
  const fingers = new Map<number, number>();
  let spread = 0;

  const perPixelS = (): number => timeWindow.spanS / Math.max(1, target.clientWidth);

  function wheel(event: WheelEvent): void {
    event.preventDefault();
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) timeWindow.pan(event.deltaX * perPixelS());
    else timeWindow.zoom(1.0015 ** event.deltaY, timeAtPointerS());
  }

  function down(event: PointerEvent): void {
    if (event.button !== 0) return;
    fingers.set(event.pointerId, event.clientX);
    spread = spreadOf();
    target.setPointerCapture(event.pointerId);
  }

  function move(event: PointerEvent): void {
    const before = fingers.get(event.pointerId);
    if (before === undefined) return;
    fingers.set(event.pointerId, event.clientX);
    if (fingers.size === 1) timeWindow.pan((before - event.clientX) * perPixelS());
    else {
      const now = spreadOf();
      if (now > 10 && spread > 10) timeWindow.zoom(spread / now, timeAtPointerS());
      spread = now;
    }
  }

  function up(event: PointerEvent): void {
    fingers.delete(event.pointerId);
    spread = spreadOf();
  }

  function spreadOf(): number {
    const xs = [...fingers.values()];
    return xs.length < 2 ? 0 : Math.max(...xs) - Math.min(...xs);
  }

  const now = (): void => timeWindow.now();
  target.addEventListener("wheel", wheel, { passive: false });
  target.addEventListener("pointerdown", down);
  target.addEventListener("pointermove", move);
  target.addEventListener("pointerup", up);
  target.addEventListener("pointercancel", up);
  target.addEventListener("dblclick", now);
  return () => {
    target.removeEventListener("wheel", wheel);
    target.removeEventListener("pointerdown", down);
    target.removeEventListener("pointermove", move);
    target.removeEventListener("pointerup", up);
    target.removeEventListener("pointercancel", up);
    target.removeEventListener("dblclick", now);
  };
}
