"use strict";
// Views by their names in page definitions. The file of a view, views/<name>.js, adds it:
//   Views.<name> = { view };
// `view(root, app)` fills its section `root` and returns {render(shown), hover(key), image(format), listed()}: what it
// shows of a selection, which point it marks, a picture and the rows to save; the last three only where it has them. `whenEmpty: true`
// beside `view` renders it before there are points. Nodes are made by Dom (dom.js), figures drawn by Figure (figure.js).
const Views = {};
