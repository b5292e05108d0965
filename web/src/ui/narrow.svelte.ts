/** Whether the page has a phone's width; the layouts switch at the same 720 px in CSS. */
class Narrow {
  is = $state(false);

  constructor() {
    const query = matchMedia("(max-width: 720px)");
    this.is = query.matches;
    query.addEventListener("change", (event) => (this.is = event.matches));
  }
}

export const narrow = new Narrow();
