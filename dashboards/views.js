"use strict";
// Views by their names in page definitions. The file of a view, views/<name>.js, adds it:
//   Views.<name> = { view };
// `view(root, app)` fills its section `root` and returns {render(shown), hover(key), image(format), listed()}: what it
// shows of a selection, which point it marks, a picture and the rows to save; the last three only where it has them.
// Beside `view`: `tabs`, in which it stands (page.js: TABS, or "always"; default "choose"); `has(page)`, whether a page has
// something for it; `whenEmpty: true` renders it before there are points. Nodes are made by Dom (dom.js), figures drawn by
// Figure (figure.js).
const Views = {};
