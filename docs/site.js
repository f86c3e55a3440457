// What the theme leaves out for those who read with a keyboard or a screen reader.
document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
document.querySelectorAll("pre > code").forEach((block) => {
  const focusable = () => block.hasAttribute("tabindex") || block.setAttribute("tabindex", "0");
  focusable();
  new MutationObserver(focusable).observe(block, { attributeFilter: ["tabindex"] }); // the theme takes it away
});
