BEGIN TRANSACTION;
CREATE TABLE baselines (
    name TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    since_ns INTEGER NOT NULL,
    until_ns INTEGER NOT NULL,
    kind TEXT,
    PRIMARY KEY (machine, name)
) WITHOUT ROWID;
INSERT INTO "baselines" VALUES('sound','dz101','abababababababababababababababababababababababababababababababab',1,0,1,'live');
CREATE TABLE sources (
    id INTEGER PRIMARY KEY,
    kind TEXT NOT NULL CHECK (kind IN ('live', 'replay', 'offline', 'synthetic')),
    name TEXT NOT NULL,
    digest TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    UNIQUE (kind, name, digest, machine, machine_sha256)
);
INSERT INTO "sources" VALUES(1,'live','/tbm/analysis_node','','dz101','abababababababababababababababababababababababababababababababab');
INSERT INTO "sources" VALUES(2,'synthetic','bags/field','cdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcd','dz101','abababababababababababababababababababababababababababababababab');
CREATE TABLE usual_errors (
    machine TEXT NOT NULL,
    baseline TEXT NOT NULL,
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    mean REAL NOT NULL,
    scatter REAL NOT NULL,
    windows INTEGER NOT NULL,
    log_mean REAL, log_scatter REAL,
    PRIMARY KEY (machine, baseline, point, axis),
    FOREIGN KEY (machine, baseline) REFERENCES baselines (machine, name) ON DELETE CASCADE
) WITHOUT ROWID;
INSERT INTO "usual_errors" VALUES('dz101','sound','shield','x',0.2,0.01,9,-0.2,0.01);
CREATE TABLE windows (
    source INTEGER NOT NULL REFERENCES sources (id),
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    start_ns INTEGER NOT NULL,
    length_ns INTEGER NOT NULL,
    field_rms REAL,
    model_rms REAL,
    relative_error REAL,
    coverage REAL NOT NULL,
    field_peak REAL,
    field_kurtosis REAL,
    PRIMARY KEY (start_ns, source, point, axis, length_ns)
) WITHOUT ROWID;
INSERT INTO "windows" VALUES(1,'shield','x',1700000000000000000,2000000000,0.5,0.4,0.2,1.0,1.5,3.0);
INSERT INTO "windows" VALUES(2,'girder','yz',1700000000000000000,2000000000,0.5,NULL,NULL,0.5,NULL,NULL);
INSERT INTO "windows" VALUES(1,'shield','x',1700000002000000000,2000000000,0.5,0.4,0.2,1.0,1.5,3.0);
COMMIT;
PRAGMA application_id = 1413631304;
PRAGMA user_version = 5;
