/** Whether single keys are shortcuts: who types by voice switches them off (WCAG 2.1.4). */

/** Where browsers keep the choice. */
const STORED = "lightwell.shortcuts";

/** The visitor's choice, kept where the browser lets the page keep it; what the address says goes first. */
export class Shortcuts {
  private chosen: boolean;

  constructor(asked: boolean | null) {
    this.chosen = asked ?? stored() ?? true;
  }

  get on(): boolean {
    return this.chosen;
  }

  set on(on: boolean) {
    this.chosen = on;
    try {
      localStorage.setItem(STORED, on ? "1" : "0");
    } catch {
      // Files and frames may keep nothing: the choice lasts as long as the page.
    }
  }
}

function stored(): boolean | null {
  try {
    const text = localStorage.getItem(STORED);
    return text === null ? null : text !== "0";
  } catch {
    return null;
  }
}
