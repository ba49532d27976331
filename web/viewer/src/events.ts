/** What happens in the viewer. */

/** What the viewer tells its controls. */
export interface ViewerEvents extends Record<string, unknown> {
  /** Something about the state below changed. */
  change: undefined;
  /** A frame was drawn. */
  frame: undefined;
  /** A short message for the user. */
  notice: string;
  /** A message that stays: the page cannot go on as it should. */
  trouble: string;
  /** A scene was loaded. */
  loaded: undefined;
  /** There are other lamps than before: after `loaded`, and when one is added or removed. */
  lamps: undefined;
}
