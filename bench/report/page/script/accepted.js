/* The page of accepted submissions: only its leaderboard is kept in the address. */
let quiet = true;

function writeAddress() {
  if (quiet) return;
  const told = new URLSearchParams();
  tellBoard((key, value, usual = "") => { if (value !== usual) told.append(key, value); });
  const hash = told.toString();
  history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
}

function applyAddress() {
  const plain = byId(location.hash.slice(1));
  quiet = true;
  heedBoard(new URLSearchParams(plain ? "" : location.hash.slice(1)));
  quiet = false;
}

setUpTheme(() => {});
setUpBoard();
setUpTables();
addEventListener("hashchange", applyAddress);
applyAddress();
