// The search of the site lists a block first that a query describes: by its name, its first sentence, or one of its
// parameters, the earlier the better. Of equal ones the block comes first that the documentation names most often.
const BLOCKS = {/* name: [share of its mentions, words of name and first sentence, words of each parameter] */};
const COMMON = ["a", "an", "and", "for", "in", "of", "on", "the", "to", "with"];
const ASKED = ((new URLSearchParams(location.search).get("q") || "").toLowerCase().match(/\w+/g) || [])
  .filter((word) => !COMMON.includes(word));
var Scorer = {  // searchtools.js declares it as well
  score([page, , , , score]) {
    const [mentions, title, ...parameters] = BLOCKS[page.match(/^api\/blocks\/(\w+)$/)?.[1]] || [];
    if (!title || !ASKED.length) return score;
    const place = [[], ...parameters].findIndex((words) => ASKED.every((word) => title.includes(word) || words.includes(word)));
    return place < 0 ? score : score + (place <= 3 ? 200 : 30) - place + mentions;
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,  // as without this file
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
