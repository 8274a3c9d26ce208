// Search of the pages by lunr. Scripts load from a folder as well, where a browser refuses workers and requests.
document.addEventListener("DOMContentLoaded", () => {
  const MOST = 30, AROUND = 90;
  const input = document.getElementById("mkdocs-search-query");
  const results = document.getElementById("mkdocs-search-results");
  const entries = new Map();
  let index = null;

  function load(path) {
    return new Promise((done, failed) => {
      const script = document.createElement("script");
      Object.assign(script, { src: `${base_url}/${path}`, onload: done, onerror: failed });
      document.head.append(script);
    });
  }

  async function build() {
    await Promise.all([load("search/lunr.js"), load("search/search_index.js")]);
    // Names such as base_wrench_regressor are found by their words.
    lunr.tokenizer.separator = /[\s\-_.,()[\]]+/;
    return lunr(function () {
      this.ref("location");
      this.field("title", { boost: 10 });
      this.field("text");
      for (const entry of searchEntries) {
        entries.set(entry.location, entry);
        this.add(entry);
      }
    });
  }

  function matches(text) {
    const words = lunr.tokenizer(text).map(String).filter((word) => word.length > 1);
    if (!words.length) return [];
    const ranked = index.query((query) => {
      for (const word of words) {
        query.term(word, { boost: 10 });
        query.term(word, { usePipeline: false, wildcard: lunr.Query.wildcard.TRAILING });
      }
    });
    const complete = ({ title, text }) => words.every((word) => `${title} ${text}`.toLowerCase().includes(word));
    // Those with every word first, otherwise in lunr's order.
    const places = ranked.map((each) => entries.get(each.ref));
    places.sort((one, other) => complete(other) - complete(one));
    return places.slice(0, MOST).map((entry) => shown(entry, words));
  }

  function shown(entry, words) {
    const page = entries.get(entry.location.split("#")[0]);
    const link = document.createElement("a");
    link.href = `${base_url}/${entry.location}`;
    link.textContent = page && page !== entry ? `${page.title} › ${entry.title}` : entry.title;
    const places = words.map((word) => entry.text.toLowerCase().indexOf(word)).filter((place) => place >= 0);
    const from = places.length ? Math.max(0, Math.min(...places) - AROUND) : 0;
    const excerpt = document.createElement("p");
    excerpt.textContent = (from ? "… " : "") + entry.text.slice(from, from + 3 * AROUND);
    const article = document.createElement("article");
    article.append(link, excerpt);
    return article;
  }

  async function search() {
    index ??= build();
    index = await index;
    const text = input.value.trim();
    const articles = text ? matches(text) : [];
    results.replaceChildren(...articles);
    if (text && !articles.length) results.textContent = "No page has these words.";
  }

  input.form.addEventListener("submit", (event) => event.preventDefault());
  input.addEventListener("input", search);
  const asked = new URLSearchParams(location.search).get("q");
  if (asked) {
    input.value = asked;
    search();
  }
});
