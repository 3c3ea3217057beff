// The search of the site lists a block first that has a parameter of the name that is looked for, above all as one of
// its first parameters.
const PARAMETERS = {/* name: {block: place among its parameters} */};
const ASKED = (new URLSearchParams(location.search).get("q") || "").toLowerCase().match(/\w+/g) || [];
var Scorer = {  // searchtools.js declares it as well
  score([page, , , , score]) {
    const block = page.match(/^api\/blocks\/(\w+)$/)?.[1];
    const places = ASKED.map((word) => PARAMETERS[word]?.[block]).filter((place) => place !== undefined);
    return places.length ? score + 30 - Math.min(...places) : score;
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,  // as without this file
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
