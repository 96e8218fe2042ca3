-- Tables of a recording. Every row has the checksum of its values, a scan with its samples.
CREATE TABLE session (              -- from opening a board to letting go of it
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,         -- of this row, as of the others below
    started REAL NOT NULL,          -- s since the epoch
    identity TEXT NOT NULL,         -- JSON: what answered
    boot INTEGER NOT NULL,
    emulated INTEGER NOT NULL,
    port TEXT NOT NULL,
    settings TEXT NOT NULL,         -- JSON: sent to the board
    settings_hash INTEGER NOT NULL, -- of every scan of this session
    wiring TEXT NOT NULL,
    capacitances TEXT NOT NULL,     -- JSON: F by state, as L was computed with while measuring
    design TEXT NOT NULL,           -- its name
    design_hash TEXT NOT NULL,
    design_document TEXT NOT NULL,  -- JSON: the design file
    version TEXT NOT NULL           -- of this program
);
CREATE TABLE self_test (            -- of the switches and coils, before and after a campaign
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,
    session INTEGER NOT NULL REFERENCES session (id),
    time REAL NOT NULL,             -- s since the epoch
    symptoms TEXT NOT NULL,         -- JSON: what a good board does not show; none if it has passed
    findings TEXT NOT NULL          -- JSON: faults that each alone explain it
);
CREATE TABLE campaign (             -- none or one row
    id INTEGER PRIMARY KEY CHECK (id = 1),
    checksum TEXT NOT NULL,
    plan TEXT NOT NULL              -- JSON: grid and sequence
);
CREATE TABLE position (             -- of the indenter, one row for every time it was begun
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,
    session INTEGER NOT NULL REFERENCES session (id),
    place INTEGER NOT NULL,         -- in the order of the campaign, from 0
    repeat INTEGER NOT NULL,        -- of the whole grid, from 0
    depth REAL NOT NULL,            -- to which is pressed, in m
    y REAL NOT NULL,                -- in m from the map's origin
    x REAL NOT NULL,
    finished REAL                   -- s since the epoch; null while it is measured, or where it was broken off
);
CREATE UNIQUE INDEX finished_places ON position (place) WHERE finished IS NOT NULL;
CREATE TABLE scan (
    id INTEGER PRIMARY KEY,
    checksum TEXT NOT NULL,         -- with that of its samples
    session INTEGER NOT NULL REFERENCES session (id),
    position INTEGER REFERENCES position (id),
    stage TEXT NOT NULL,            -- what was going on: stream, single, baseline, peak
    depth REAL,                     -- of the indenter in m where it is known, 0 where it does not touch
    temperature REAL,               -- of the board or beside it in °C, where a thermometer was given
    sequence INTEGER NOT NULL,      -- as the board counts
    time REAL NOT NULL,             -- s by the board's clock
    received REAL NOT NULL          -- s since the epoch by the computer's clock
);
CREATE INDEX scans_of_positions ON scan (position);
CREATE TABLE sample (
    scan INTEGER NOT NULL REFERENCES scan (id),
    state INTEGER NOT NULL,         -- in the order of the settings, from 0
    msb INTEGER NOT NULL,           -- register DATA0_MSB with its error flags
    lsb INTEGER NOT NULL,           -- register DATA0_LSB
    status INTEGER NOT NULL,        -- register STATUS
    fault INTEGER NOT NULL,         -- 0, or why there are no words
    PRIMARY KEY (scan, state)
) WITHOUT ROWID;
