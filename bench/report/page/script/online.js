/* The page of an online study: its charts are there already. */
setUpTheme(() => {});
setUpTables();
