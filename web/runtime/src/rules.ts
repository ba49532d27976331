/** Rules that untrusted JSON is held to, put together into tables: each throws a `FormatError` that names the place. */

import { fail, integer, list, number, record } from "./checks.ts";

/** Checks a value at a place of a document. */
export type Rule = (value: unknown, where: string) => void;

/** Longest name, URI or word that is read; data URIs are checked by what reads them. */
const MAX_TEXT = 1 << 16;

/** A string, of one of some words if any are given. */
export function words(...known: readonly string[]): Rule {
  return (value, where) => {
    if (typeof value !== "string" || (known.length === 0 && value.length > MAX_TEXT))
      fail(where, `a string of at most ${MAX_TEXT} characters`);
    if (known.length > 0 && !known.includes(value)) fail(where, `one of ${known.join(", ")}`);
  };
}

/** Text of any length: data URIs. */
export const uri: Rule = (value, where) => {
  if (typeof value !== "string") fail(where, "a string");
};

/** True or false. */
export const flag: Rule = (value, where) => {
  if (typeof value !== "boolean") fail(where, "true or false");
};

/** A finite number in [low, high]. */
export const range =
  (low = -Infinity, high = Infinity): Rule =>
  (value, where) =>
    void number(value, where, low, high);

/** A whole number in [low, high]. */
export const whole =
  (low: number, high: number): Rule =>
  (value, where) =>
    void integer(value, where, low, high);

/** One of some numbers. */
export const oneOf =
  (...known: readonly number[]): Rule =>
  (value, where) => {
    if (!known.includes(value as number)) fail(where, `one of ${known.join(", ")}`);
  };

/** An array of entries that follow a rule. */
export const each =
  (rule: Rule, low: number, high: number): Rule =>
  (value, where) => {
    const entries = list(value, where, high);
    if (entries.length < low) fail(where, `at least ${low} entries, found ${entries.length}`);
    entries.forEach((entry, i) => rule(entry, `${where}[${i}]`));
  };

/** So many finite numbers in [low, high]. */
export const numbers = (count: number, low = -Infinity, high = Infinity): Rule => each(range(low, high), count, count);

/** An object whose members follow rules by name; what has no rule is ignored, as glTF asks. */
export const members =
  (rules: Readonly<Record<string, Rule>>, ...required: readonly string[]): Rule =>
  (value, where) => {
    const entry = record(value, where);
    for (const name of required) if (entry[name] === undefined) fail(`${where}.${name}`, "a value");
    for (const [name, rule] of Object.entries(rules)) if (entry[name] !== undefined) rule(entry[name], `${where}.${name}`);
  };

/** An object whose members all follow one rule. */
export const dictionary =
  (rule: Rule, low: number, high: number): Rule =>
  (value, where) => {
    const entries = Object.entries(record(value, where));
    if (entries.length < low || entries.length > high) fail(where, `${low} to ${high} entries, found ${entries.length}`);
    for (const [name, entry] of entries) rule(entry, `${where}.${name.slice(0, 40)}`);
  };
