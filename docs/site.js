// What the theme leaves out for those who read with a keyboard or a screen reader.
document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
document.querySelectorAll("pre > code").forEach((block) => {
  const focusable = () => block.hasAttribute("tabindex") || block.setAttribute("tabindex", "0");
  focusable();
  new MutationObserver(focusable).observe(block, { attributeFilter: ["tabindex"] }); // the theme takes it away
});
const scrollable = () =>
  document.querySelectorAll(".md-typeset__scrollwrap").forEach((table) => {
    if (table.scrollWidth > table.clientWidth) table.tabIndex = 0;
    else table.removeAttribute("tabindex");
  });
addEventListener("resize", scrollable);
new MutationObserver(scrollable).observe(document.body, { childList: true, subtree: true }); // the theme wraps tables late
