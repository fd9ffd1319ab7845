BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0001');
CREATE TABLE attempts (
	id VARCHAR(32) NOT NULL, 
	shard_id VARCHAR(32) NOT NULL, 
	fence INTEGER NOT NULL, 
	engine VARCHAR(80) NOT NULL, 
	state VARCHAR(80) NOT NULL, 
	token_hash VARCHAR(64) NOT NULL, 
	leased DATETIME NOT NULL, 
	ended DATETIME, 
	reason VARCHAR, 
	PRIMARY KEY (id), 
	FOREIGN KEY(shard_id) REFERENCES shards (id), 
	UNIQUE (shard_id, fence)
);
INSERT INTO "attempts" VALUES('at_01M82CJEMVHY9DP405S8ZR4NR8','sh_01M82CJEGEVR8XRX7JB1WWQ1BD',1,'local','done','7e69d1e06914733a48c045cad7a18efdd9c82731427f42ce2c94fc1b605b15d3','2026-11-22 19:43:46.397429','2026-11-22 19:43:47.684463',NULL);
INSERT INTO "attempts" VALUES('at_01M82CJG16XJ3CKZ0AX531JX8X','sh_01M82CJEH7BARXZQBZMY4AF61D',1,'local','done','860344f35967170097fa65f7bc1d8993e9c3b454e0bfe950cb88233d18202ebe','2026-11-22 19:43:47.751609','2026-11-22 19:43:47.923483',NULL);
INSERT INTO "attempts" VALUES('at_01M82CJGK7PKR7N0S7DJK2BF5P','sh_01M82CJGHTV6GBE9WH79MXSE0D',1,'local','open','512fd7f68d7557ba3827d03df6492cc7889a78c04498d9f1860b969744c0ebf2','2026-11-22 19:43:48.328851',NULL,NULL);
CREATE TABLE blobs (
	sha256 VARCHAR(64) NOT NULL, 
	size INTEGER NOT NULL, 
	media_type VARCHAR(80) NOT NULL, 
	created DATETIME NOT NULL, 
	PRIMARY KEY (sha256)
);
INSERT INTO "blobs" VALUES('1cb908ec2c3d2df58407ae3ff7e0b91f36eec794ed7a0b9cb27ce32256c53f6e',883,'image/jpeg','2026-11-22 19:43:47.496658');
INSERT INTO "blobs" VALUES('cdae16610707d3e6872542566c39f3885a8ae63ffcdf0095819e78a4034babe2',884,'image/jpeg','2026-11-22 19:43:47.646399');
CREATE TABLE decisions (
	episode_id VARCHAR(32) NOT NULL, 
	number INTEGER NOT NULL, 
	time DOUBLE NOT NULL, 
	action JSON NOT NULL, 
	outcome VARCHAR(80) NOT NULL, 
	retried BOOLEAN NOT NULL, 
	path VARCHAR(80) NOT NULL, 
	stage VARCHAR NOT NULL, 
	hidden JSON NOT NULL, 
	checks JSON NOT NULL, 
	success BOOLEAN NOT NULL, 
	events JSON NOT NULL, 
	violations JSON NOT NULL, 
	belief JSON, 
	PRIMARY KEY (episode_id, number), 
	FOREIGN KEY(episode_id) REFERENCES episodes (id)
)
 WITHOUT ROWID

;
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',0,1.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 1','{"presses_done": 1, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',1,3.0,'{"kind": "keyframe", "position": [0.3, 0.0, 0.91], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','no_path',0,'','press 2','{"presses_done": 2, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',2,4.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.92], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 3','{"presses_done": 3, "item_in": "top"}','{"pressed_exactly": true, "arm_withdrawn": true}',1,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',0,1.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 1','{"presses_done": 1, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',1,3.0,'{"kind": "keyframe", "position": [0.3, 0.0, 0.91], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','no_path',0,'','press 2','{"presses_done": 2, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',2,4.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.92], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 3','{"presses_done": 3, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": true}',0,'[]','["undercount"]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',0,1.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 1','{"presses_done": 1, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',1,3.0,'{"kind": "keyframe", "position": [0.3, 0.0, 0.91], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','no_path',0,'','press 2','{"presses_done": 2, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',2,4.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.92], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 3','{"presses_done": 3, "item_in": "top"}','{"pressed_exactly": true, "arm_withdrawn": true}',1,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',0,1.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 1','{"presses_done": 1, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',1,3.0,'{"kind": "keyframe", "position": [0.3, 0.0, 0.91], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','no_path',0,'','press 2','{"presses_done": 2, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": false}',0,'[]','[]',NULL);
INSERT INTO "decisions" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',2,4.5,'{"kind": "keyframe", "position": [0.3, 0.0, 0.92], "quaternion": [0.0, 1.0, 0.0, 0.0], "opening": 1.0, "ignore_collisions": false, "stop": false}','arrived',0,'straight','press 3','{"presses_done": 3, "item_in": "top"}','{"pressed_exactly": false, "arm_withdrawn": true}',0,'[]','["undercount"]',NULL);
CREATE TABLE divergences (
	id VARCHAR(32) NOT NULL, 
	episode_id VARCHAR(32) NOT NULL, 
	attempt_id VARCHAR(32) NOT NULL, 
	kept VARCHAR(64) NOT NULL, 
	other VARCHAR(64) NOT NULL, 
	result JSON NOT NULL, 
	created DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(attempt_id) REFERENCES attempts (id), 
	FOREIGN KEY(episode_id) REFERENCES episodes (id)
);
INSERT INTO "divergences" VALUES('dv_01M82CJGENYBC6KN837NKSGDTG','ep_01M82CJEH6YVZ3SWXSA5VMK7NP','at_01M82CJEMVHY9DP405S8ZR4NR8','c58268ccfc10915c8866d7bafe86fcf2b9fb965ed82e0964f210f7bea970930f','fe9ed580c843e8d4a210437e6bb24e0080de9f2a54580e993dddf0c90f44af12','{"task": "push_button_times", "split": "test", "index": 0, "variation": {"count": 2, "color": "black"}, "instruction": "do push_button_times", "success": true, "exact": false, "failure": "overcount", "detail": "", "decisions": 3, "stage": "press 3", "scene_hash": "e0568f895e0493c4bac46f147bdcbbaa00f1933a1f11acaea2281c0f697c75b1", "final_state_hash": "ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff", "recording": null, "timing": {"physics": 0.0, "rendering": 0.0, "planning": 0.0, "policy": 0.0, "recording": 0.0, "total": 0.5, "steps": 1080, "renders": 4}}','2026-11-22 19:43:48.206798');
CREATE TABLE episodes (
	id VARCHAR(32) NOT NULL, 
	evaluation_id VARCHAR(32) NOT NULL, 
	shard_id VARCHAR(32) NOT NULL, 
	task VARCHAR(80) NOT NULL, 
	category VARCHAR(80) NOT NULL, 
	split VARCHAR(80) NOT NULL, 
	"index" INTEGER NOT NULL, 
	variation JSON NOT NULL, 
	draw INTEGER NOT NULL, 
	state VARCHAR(80) NOT NULL, 
	fence INTEGER NOT NULL, 
	started DATETIME, 
	success BOOLEAN, 
	exact BOOLEAN, 
	failure VARCHAR(80), 
	detail VARCHAR NOT NULL, 
	instruction VARCHAR, 
	decisions INTEGER, 
	stage VARCHAR, 
	scene_hash VARCHAR(64), 
	final_state_hash VARCHAR(64), 
	start JSON, 
	timing JSON, 
	digest VARCHAR(64), 
	recording VARCHAR(64), 
	thumbnail VARCHAR(64), 
	committed DATETIME, 
	PRIMARY KEY (id), 
	CONSTRAINT final_is_whole CHECK ((state = 'final') = (digest IS NOT NULL AND success IS NOT NULL AND exact IS NOT NULL AND committed IS NOT NULL)), 
	CONSTRAINT exact_has_no_failure CHECK (exact IS NULL OR exact = (failure IS NULL)), 
	FOREIGN KEY(evaluation_id) REFERENCES evaluations (id), 
	FOREIGN KEY(recording) REFERENCES blobs (sha256), 
	FOREIGN KEY(shard_id) REFERENCES shards (id), 
	FOREIGN KEY(thumbnail) REFERENCES blobs (sha256), 
	UNIQUE (evaluation_id, task, "index")
);
INSERT INTO "episodes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','ev_01M82CJEEENKDK4NAX0WTVBA4V','sh_01M82CJEGEVR8XRX7JB1WWQ1BD','push_button_times','RC','test',0,'{"count": 2, "color": "black"}',0,'final',1,'2026-11-22 19:43:46.568687',1,1,NULL,'','do push_button_times',3,'press 3','e0568f895e0493c4bac46f147bdcbbaa00f1933a1f11acaea2281c0f697c75b1','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff','{"stage": "press 1", "hidden": {"presses_done": 0, "item_in": "top"}, "checks": {"pressed_exactly": false}, "success": false, "belief": null}','{"physics": 0.0, "rendering": 0.0, "planning": 0.0, "policy": 0.0, "recording": 0.0, "total": 0.5, "steps": 1080, "renders": 4}','c58268ccfc10915c8866d7bafe86fcf2b9fb965ed82e0964f210f7bea970930f',NULL,'1cb908ec2c3d2df58407ae3ff7e0b91f36eec794ed7a0b9cb27ce32256c53f6e','2026-11-22 19:43:47.513850');
INSERT INTO "episodes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','ev_01M82CJEEENKDK4NAX0WTVBA4V','sh_01M82CJEGEVR8XRX7JB1WWQ1BD','push_button_times','RC','test',1,'{"count": 1, "color": "red"}',0,'final',1,'2026-11-22 19:43:47.554055',0,0,'undercount','','do push_button_times',3,'press 3','c2e494bcd4447c727a885e5b9cf909a129c729e12080c3d03742e5176b8db9e6','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff','{"stage": "press 1", "hidden": {"presses_done": 0, "item_in": "top"}, "checks": {"pressed_exactly": false}, "success": false, "belief": null}','{"physics": 0.0, "rendering": 0.0, "planning": 0.0, "policy": 0.0, "recording": 0.0, "total": 0.5, "steps": 1080, "renders": 4}','246801919754a84e594d05b56d9c7c0c7a27b2111aec4470ac40856de39c3526',NULL,'cdae16610707d3e6872542566c39f3885a8ae63ffcdf0095819e78a4034babe2','2026-11-22 19:43:47.646752');
INSERT INTO "episodes" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','ev_01M82CJEEENKDK4NAX0WTVBA4V','sh_01M82CJEH7BARXZQBZMY4AF61D','search_drawer','EPT','test',0,'{"item_in": "middle"}',0,'final',1,'2026-11-22 19:43:47.782322',1,1,NULL,'','do search_drawer',3,'press 3','f2ce6d501978f37016cc9d43e24f7b90acf97f99364964baf2da0c739cb8c43f','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff','{"stage": "press 1", "hidden": {"presses_done": 0, "item_in": "top"}, "checks": {"pressed_exactly": false}, "success": false, "belief": null}','{"physics": 0.0, "rendering": 0.0, "planning": 0.0, "policy": 0.0, "recording": 0.0, "total": 0.5, "steps": 1080, "renders": 4}','336ea4de22ad559aee909f9ffe8ce0b7c4cfa98d192ded02b80d0ed0c421479e',NULL,'1cb908ec2c3d2df58407ae3ff7e0b91f36eec794ed7a0b9cb27ce32256c53f6e','2026-11-22 19:43:47.820328');
INSERT INTO "episodes" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','ev_01M82CJEEENKDK4NAX0WTVBA4V','sh_01M82CJEH7BARXZQBZMY4AF61D','search_drawer','EPT','test',1,'{"item_in": "middle"}',0,'final',1,'2026-11-22 19:43:47.853412',0,0,'undercount','','do search_drawer',3,'press 3','e315640356e2f9e5bbe8c2207745caff0cd0b00e5610025d82fe2e3c03ddf740','ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff','{"stage": "press 1", "hidden": {"presses_done": 0, "item_in": "top"}, "checks": {"pressed_exactly": false}, "success": false, "belief": null}','{"physics": 0.0, "rendering": 0.0, "planning": 0.0, "policy": 0.0, "recording": 0.0, "total": 0.5, "steps": 1080, "renders": 4}','90a9811b3edead94e846947733b4d97b1ff83380c82f91ac1baf6a56b3deff0a',NULL,'cdae16610707d3e6872542566c39f3885a8ae63ffcdf0095819e78a4034babe2','2026-11-22 19:43:47.921945');
INSERT INTO "episodes" VALUES('ep_01M82CJGHVWP4M2135KZ0G191R','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHTV6GBE9WH79MXSE0D','search_drawer','EPT','test',0,'{"item_in": "middle"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHVWP4M2135KZ0G191S','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHTV6GBE9WH79MXSE0D','search_drawer','EPT','test',1,'{"item_in": "middle"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHVWP4M2135KZ0G191T','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHTV6GBE9WH79MXSE0D','search_drawer','EPT','test',2,'{"item_in": "bottom"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHVWP4M2135KZ0G191V','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHTV6GBE9WH79MXSE0D','search_drawer','EPT','test',3,'{"item_in": "middle"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHVWP4M2135KZ0G191W','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHTV6GBE9WH79MXSE0D','search_drawer','EPT','test',4,'{"item_in": "top"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHW7PNTQN2PZX0MNWAG','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHVWP4M2135KZ0G191X','search_drawer','EPT','test',5,'{"item_in": "top"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "episodes" VALUES('ep_01M82CJGHXHTAPT50EABMQ566Z','ev_01M82CJGGQT21SGE6Q4QR5DQMN','sh_01M82CJGHVWP4M2135KZ0G191X','search_drawer','EPT','test',6,'{"item_in": "top"}',0,'pending',0,NULL,NULL,NULL,NULL,'',NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL,NULL);
CREATE TABLE evaluations (
	id VARCHAR(32) NOT NULL, 
	policy_version_id VARCHAR(32) NOT NULL, 
	suite VARCHAR(80) NOT NULL, 
	suite_version INTEGER NOT NULL, 
	split VARCHAR(80) NOT NULL, 
	rules VARCHAR(80) NOT NULL, 
	tasks JSON NOT NULL, 
	episodes INTEGER NOT NULL, 
	sources JSON NOT NULL, 
	machine JSON NOT NULL, 
	priority INTEGER NOT NULL, 
	recordings BOOLEAN NOT NULL, 
	state VARCHAR(80) NOT NULL, 
	desired VARCHAR(80) NOT NULL, 
	reason VARCHAR, 
	created DATETIME NOT NULL, 
	started DATETIME, 
	ended DATETIME, 
	idempotency_key VARCHAR(200), 
	request_digest VARCHAR(64), 
	PRIMARY KEY (id), 
	FOREIGN KEY(policy_version_id) REFERENCES policy_versions (id), 
	UNIQUE (idempotency_key)
);
INSERT INTO "evaluations" VALUES('ev_01M82CJEEENKDK4NAX0WTVBA4V','pv_01M82CHYTJQGP28K731FHYB3BG','hide',1,'test','hide','["push_button_times", "search_drawer"]',2,'{"push_button_times": "603d50149413b11b26f199fbef4009f7d24c5a089b975326843739115f872b8c", "search_drawer": "dc50a0acfe0459d9d4b5a797b7833756ff5e9a1470139a4094bcf0698e3ecb07"}','{"processor": "Intel(R) Xeon(R) Processor", "instructions": "fma avx2 avx512f", "libc": "glibc 2.36", "python": "3.11.7", "numpy": "2.4.6", "numba": "0.68.1", "pybullet": "3.2.7"}',0,1,'completed','finished',NULL,'2026-11-22 19:43:46.169059','2026-11-22 19:43:46.448027','2026-11-22 19:43:47.949701',NULL,'9fe3f6d633567ba3ffa7ee7cef770d6455798713e188878a6937ca7a65593e17');
INSERT INTO "evaluations" VALUES('ev_01M82CJGGQT21SGE6Q4QR5DQMN','pv_01M82CJGAQC7KFNZXT8RJM3GXT','hide',1,'test','hide','["search_drawer"]',7,'{"search_drawer": "dc50a0acfe0459d9d4b5a797b7833756ff5e9a1470139a4094bcf0698e3ecb07"}','{"processor": "Intel(R) Xeon(R) Processor", "instructions": "fma avx2 avx512f", "libc": "glibc 2.36", "python": "3.11.7", "numpy": "2.4.6", "numba": "0.68.1", "pybullet": "3.2.7"}',0,1,'running','finished',NULL,'2026-11-22 19:43:48.282325','2026-11-22 19:43:48.366491',NULL,NULL,'fbf50fdd1df460793a15fbfe56f833006235a4adf1342f6c00e5fe142af831ed');
CREATE TABLE events (
	seq INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, 
	time DATETIME NOT NULL, 
	evaluation_id VARCHAR(32) NOT NULL, 
	kind VARCHAR(80) NOT NULL, 
	payload JSON NOT NULL, 
	FOREIGN KEY(evaluation_id) REFERENCES evaluations (id)
);
INSERT INTO "events" VALUES(1,'2026-11-22 19:43:46.290127','ev_01M82CJEEENKDK4NAX0WTVBA4V','evaluation','{"state": "queued", "reason": null}');
INSERT INTO "events" VALUES(2,'2026-11-22 19:43:46.448593','ev_01M82CJEEENKDK4NAX0WTVBA4V','evaluation','{"state": "running", "reason": null}');
INSERT INTO "events" VALUES(3,'2026-11-22 19:43:47.353216','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEH6YVZ3SWXSA5VMK7NP", "task": "push_button_times", "index": 0, "state": "running", "success": null, "exact": null, "failure": null}');
INSERT INTO "events" VALUES(4,'2026-11-22 19:43:47.590427','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEH6YVZ3SWXSA5VMK7NP", "task": "push_button_times", "index": 0, "state": "final", "success": true, "exact": true, "failure": null}');
INSERT INTO "events" VALUES(5,'2026-11-22 19:43:47.590433','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEH6YVZ3SWXSA5VMK7NQ", "task": "push_button_times", "index": 1, "state": "running", "success": null, "exact": null, "failure": null}');
INSERT INTO "events" VALUES(6,'2026-11-22 19:43:47.684014','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEH6YVZ3SWXSA5VMK7NQ", "task": "push_button_times", "index": 1, "state": "final", "success": false, "exact": false, "failure": "undercount"}');
INSERT INTO "events" VALUES(7,'2026-11-22 19:43:47.685079','ev_01M82CJEEENKDK4NAX0WTVBA4V','attempt','{"task": "push_button_times", "fence": 1, "state": "done", "reason": null}');
INSERT INTO "events" VALUES(8,'2026-11-22 19:43:47.817451','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEJ78DHV7W34P347RASR", "task": "search_drawer", "index": 0, "state": "running", "success": null, "exact": null, "failure": null}');
INSERT INTO "events" VALUES(9,'2026-11-22 19:43:47.856403','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEJ78DHV7W34P347RASR", "task": "search_drawer", "index": 0, "state": "final", "success": true, "exact": true, "failure": null}');
INSERT INTO "events" VALUES(10,'2026-11-22 19:43:47.856411','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEJ78DHV7W34P347RASS", "task": "search_drawer", "index": 1, "state": "running", "success": null, "exact": null, "failure": null}');
INSERT INTO "events" VALUES(11,'2026-11-22 19:43:47.923197','ev_01M82CJEEENKDK4NAX0WTVBA4V','episode','{"id": "ep_01M82CJEJ78DHV7W34P347RASS", "task": "search_drawer", "index": 1, "state": "final", "success": false, "exact": false, "failure": "undercount"}');
INSERT INTO "events" VALUES(12,'2026-11-22 19:43:47.924020','ev_01M82CJEEENKDK4NAX0WTVBA4V','attempt','{"task": "search_drawer", "fence": 1, "state": "done", "reason": null}');
INSERT INTO "events" VALUES(13,'2026-11-22 19:43:47.951113','ev_01M82CJEEENKDK4NAX0WTVBA4V','evaluation','{"state": "completed", "reason": null}');
INSERT INTO "events" VALUES(14,'2026-11-22 19:43:48.207312','ev_01M82CJEEENKDK4NAX0WTVBA4V','divergence','{"id": "ep_01M82CJEH6YVZ3SWXSA5VMK7NP", "kept": "c58268ccfc10915c8866d7bafe86fcf2b9fb965ed82e0964f210f7bea970930f"}');
INSERT INTO "events" VALUES(15,'2026-11-22 19:43:48.327034','ev_01M82CJGGQT21SGE6Q4QR5DQMN','evaluation','{"state": "queued", "reason": null}');
INSERT INTO "events" VALUES(16,'2026-11-22 19:43:48.367101','ev_01M82CJGGQT21SGE6Q4QR5DQMN','evaluation','{"state": "running", "reason": null}');
CREATE TABLE hidden_changes (
	episode_id VARCHAR(32) NOT NULL, 
	number INTEGER NOT NULL, 
	time DOUBLE NOT NULL, 
	decision INTEGER NOT NULL, 
	stage VARCHAR NOT NULL, 
	hidden JSON NOT NULL, 
	PRIMARY KEY (episode_id, number), 
	FOREIGN KEY(episode_id) REFERENCES episodes (id)
)
 WITHOUT ROWID

;
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',0,0.0,0,'press 1','{"presses_done": 0, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',1,1.5,1,'press 1','{"presses_done": 1, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',2,3.0,2,'press 2','{"presses_done": 2, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP',3,4.5,3,'press 3','{"presses_done": 3, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',0,0.0,0,'press 1','{"presses_done": 0, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',1,1.5,1,'press 1','{"presses_done": 1, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',2,3.0,2,'press 2','{"presses_done": 2, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ',3,4.5,3,'press 3','{"presses_done": 3, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',0,0.0,0,'press 1','{"presses_done": 0, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',1,1.5,1,'press 1','{"presses_done": 1, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',2,3.0,2,'press 2','{"presses_done": 2, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASR',3,4.5,3,'press 3','{"presses_done": 3, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',0,0.0,0,'press 1','{"presses_done": 0, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',1,1.5,1,'press 1','{"presses_done": 1, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',2,3.0,2,'press 2','{"presses_done": 2, "item_in": "top"}');
INSERT INTO "hidden_changes" VALUES('ep_01M82CJEJ78DHV7W34P347RASS',3,4.5,3,'press 3','{"presses_done": 3, "item_in": "top"}');
CREATE TABLE hidden_spans (
	episode_id VARCHAR(32) NOT NULL, 
	kind VARCHAR(80) NOT NULL, 
	name VARCHAR(80) NOT NULL, 
	number INTEGER NOT NULL, 
	value JSON NOT NULL, 
	decision_from INTEGER NOT NULL, 
	decision_to INTEGER NOT NULL, 
	time_from DOUBLE NOT NULL, 
	time_to DOUBLE NOT NULL, 
	PRIMARY KEY (episode_id, kind, name, number), 
	FOREIGN KEY(episode_id) REFERENCES episodes (id)
)
 WITHOUT ROWID

;
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','hidden','item_in',0,'"top"',0,3,0.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','hidden','presses_done',0,0,0,1,0.0,1.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','hidden','presses_done',1,1,1,2,1.5,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','hidden','presses_done',2,2,2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','hidden','presses_done',3,3,3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','stage','stage',0,'"press 1"',0,2,0.0,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','stage','stage',1,'"press 2"',2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NP','stage','stage',2,'"press 3"',3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','hidden','item_in',0,'"top"',0,3,0.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','hidden','presses_done',0,0,0,1,0.0,1.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','hidden','presses_done',1,1,1,2,1.5,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','hidden','presses_done',2,2,2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','hidden','presses_done',3,3,3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','stage','stage',0,'"press 1"',0,2,0.0,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','stage','stage',1,'"press 2"',2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEH6YVZ3SWXSA5VMK7NQ','stage','stage',2,'"press 3"',3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','hidden','item_in',0,'"top"',0,3,0.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','hidden','presses_done',0,0,0,1,0.0,1.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','hidden','presses_done',1,1,1,2,1.5,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','hidden','presses_done',2,2,2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','hidden','presses_done',3,3,3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','stage','stage',0,'"press 1"',0,2,0.0,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','stage','stage',1,'"press 2"',2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASR','stage','stage',2,'"press 3"',3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','hidden','item_in',0,'"top"',0,3,0.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','hidden','presses_done',0,0,0,1,0.0,1.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','hidden','presses_done',1,1,1,2,1.5,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','hidden','presses_done',2,2,2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','hidden','presses_done',3,3,3,3,4.5,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','stage','stage',0,'"press 1"',0,2,0.0,3.0);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','stage','stage',1,'"press 2"',2,3,3.0,4.5);
INSERT INTO "hidden_spans" VALUES('ep_01M82CJEJ78DHV7W34P347RASS','stage','stage',2,'"press 3"',3,3,4.5,4.5);
CREATE TABLE policies (
	id VARCHAR(32) NOT NULL, 
	name VARCHAR(80) NOT NULL, 
	created DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (name)
);
INSERT INTO "policies" VALUES('po_01M82CHYNZEM2C76VNNBT9GEMM','expert','2026-11-22 19:43:30.053985');
INSERT INTO "policies" VALUES('po_01M82CHYWW2NSVANVMH18Q6KN1','amnesiac','2026-11-22 19:43:30.273981');
INSERT INTO "policies" VALUES('po_01M82CHZ2HVZEYTFMP9XMEM51K','random','2026-11-22 19:43:30.386504');
INSERT INTO "policies" VALUES('po_01M82CHZ4FMMQXVJZFH347NXDM','noop','2026-11-22 19:43:30.448128');
INSERT INTO "policies" VALUES('po_01M82CJGA5Z88284HHW5WEW6AE','mine','2026-11-22 19:43:48.038541');
CREATE TABLE policy_versions (
	id VARCHAR(32) NOT NULL, 
	policy_id VARCHAR(32) NOT NULL, 
	number INTEGER NOT NULL, 
	description VARCHAR NOT NULL, 
	spec JSON NOT NULL, 
	reference BOOLEAN NOT NULL, 
	created DATETIME NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(policy_id) REFERENCES policies (id), 
	UNIQUE (policy_id, number)
);
INSERT INTO "policy_versions" VALUES('pv_01M82CHYTJQGP28K731FHYB3BG','po_01M82CHYNZEM2C76VNNBT9GEMM',1,'Follows the task''s script with the hidden state in hand.','{"kind": "builtin", "name": "expert"}',1,'2026-11-22 19:43:30.202542');
INSERT INTO "policy_versions" VALUES('pv_01M82CHYZ3RRMPXF17D7SMPQAV','po_01M82CHYWW2NSVANVMH18Q6KN1',1,'Perfect sight and skill, and no memory.','{"kind": "builtin", "name": "amnesiac"}',1,'2026-11-22 19:43:30.345869');
INSERT INTO "policy_versions" VALUES('pv_01M82CHZ2MB3QY8EE61GMKH6CB','po_01M82CHZ2HVZEYTFMP9XMEM51K',1,'Moves to random poses.','{"kind": "builtin", "name": "random"}',1,'2026-11-22 19:43:30.445515');
INSERT INTO "policy_versions" VALUES('pv_01M82CHZ6SYVXHJEMJ85NYCD36','po_01M82CHZ4FMMQXVJZFH347NXDM',1,'Does nothing.','{"kind": "builtin", "name": "noop"}',1,'2026-11-22 19:43:30.523318');
INSERT INTO "policy_versions" VALUES('pv_01M82CJGAQC7KFNZXT8RJM3GXT','po_01M82CJGA5Z88284HHW5WEW6AE',1,'','{"kind": "python", "target": "tests.workers.some_policies:Stays", "timeout": 60.0, "sha256": null}',0,'2026-11-22 19:43:48.056479');
CREATE TABLE shards (
	id VARCHAR(32) NOT NULL, 
	evaluation_id VARCHAR(32) NOT NULL, 
	task VARCHAR(80) NOT NULL, 
	first_index INTEGER NOT NULL, 
	state VARCHAR(80) NOT NULL, 
	fence INTEGER NOT NULL, 
	faults INTEGER NOT NULL, 
	reason VARCHAR, 
	PRIMARY KEY (id), 
	FOREIGN KEY(evaluation_id) REFERENCES evaluations (id), 
	UNIQUE (evaluation_id, task, first_index)
);
INSERT INTO "shards" VALUES('sh_01M82CJEGEVR8XRX7JB1WWQ1BD','ev_01M82CJEEENKDK4NAX0WTVBA4V','push_button_times',0,'done',1,0,NULL);
INSERT INTO "shards" VALUES('sh_01M82CJEH7BARXZQBZMY4AF61D','ev_01M82CJEEENKDK4NAX0WTVBA4V','search_drawer',0,'done',1,0,NULL);
INSERT INTO "shards" VALUES('sh_01M82CJGHTV6GBE9WH79MXSE0D','ev_01M82CJGGQT21SGE6Q4QR5DQMN','search_drawer',0,'leased',1,0,NULL);
INSERT INTO "shards" VALUES('sh_01M82CJGHVWP4M2135KZ0G191X','ev_01M82CJGGQT21SGE6Q4QR5DQMN','search_drawer',5,'pending',0,0,NULL);
CREATE INDEX evaluations_by_state ON evaluations (state, id);
CREATE INDEX ix_evaluations_policy_version_id ON evaluations (policy_version_id);
CREATE INDEX events_by_evaluation ON events (evaluation_id, seq);
CREATE INDEX shards_by_state ON shards (state, evaluation_id);
CREATE INDEX attempts_by_state ON attempts (state);
CREATE UNIQUE INDEX one_open_attempt ON attempts (shard_id) WHERE state = 'open';
CREATE INDEX episodes_by_failure ON episodes (evaluation_id, failure, category);
CREATE INDEX episodes_by_shard ON episodes (shard_id);
CREATE INDEX ix_divergences_episode_id ON divergences (episode_id);
CREATE INDEX hidden_spans_by_name ON hidden_spans (kind, name);
CREATE TRIGGER evaluations_begin BEFORE INSERT ON evaluations FOR EACH ROW WHEN NEW.state <> 'queued' BEGIN SELECT RAISE(ABORT, 'evaluations begin as queued'); END;
CREATE TRIGGER evaluations_move BEFORE UPDATE OF state ON evaluations FOR EACH ROW WHEN OLD.state <> NEW.state AND NOT ((OLD.state = 'queued' AND NEW.state IN ('running', 'completed', 'incomplete', 'cancelled')) OR (OLD.state = 'running' AND NEW.state IN ('completed', 'incomplete', 'cancelled')) OR (OLD.state = 'incomplete' AND NEW.state IN ('queued', 'cancelled'))) BEGIN SELECT RAISE(ABORT, 'evaluations do not move so'); END;
CREATE TRIGGER shards_begin BEFORE INSERT ON shards FOR EACH ROW WHEN NEW.state <> 'pending' BEGIN SELECT RAISE(ABORT, 'shards begin as pending'); END;
CREATE TRIGGER shards_move BEFORE UPDATE OF state ON shards FOR EACH ROW WHEN OLD.state <> NEW.state AND NOT ((OLD.state = 'pending' AND NEW.state IN ('leased', 'failed', 'cancelled')) OR (OLD.state = 'leased' AND NEW.state IN ('pending', 'done', 'failed', 'cancelled')) OR (OLD.state = 'failed' AND NEW.state IN ('pending', 'cancelled'))) BEGIN SELECT RAISE(ABORT, 'shards do not move so'); END;
CREATE TRIGGER attempts_begin BEFORE INSERT ON attempts FOR EACH ROW WHEN NEW.state <> 'open' BEGIN SELECT RAISE(ABORT, 'attempts begin as open'); END;
CREATE TRIGGER attempts_move BEFORE UPDATE OF state ON attempts FOR EACH ROW WHEN OLD.state <> NEW.state AND NOT ((OLD.state = 'open' AND NEW.state IN ('done', 'lost', 'cancelled'))) BEGIN SELECT RAISE(ABORT, 'attempts do not move so'); END;
CREATE TRIGGER episodes_begin BEFORE INSERT ON episodes FOR EACH ROW WHEN NEW.state <> 'pending' BEGIN SELECT RAISE(ABORT, 'episodes begin as pending'); END;
CREATE TRIGGER episodes_move BEFORE UPDATE OF state ON episodes FOR EACH ROW WHEN OLD.state <> NEW.state AND NOT ((OLD.state = 'pending' AND NEW.state IN ('running', 'final')) OR (OLD.state = 'running' AND NEW.state IN ('pending', 'final'))) BEGIN SELECT RAISE(ABORT, 'episodes do not move so'); END;
CREATE TRIGGER episodes_update_0 BEFORE UPDATE ON episodes FOR EACH ROW WHEN OLD.state = 'final' BEGIN SELECT RAISE(ABORT, 'a final episode is immutable'); END;
CREATE TRIGGER episodes_delete_1 BEFORE DELETE ON episodes FOR EACH ROW WHEN OLD.state = 'final' BEGIN SELECT RAISE(ABORT, 'a final episode is immutable'); END;
CREATE TRIGGER decisions_insert_2 BEFORE INSERT ON decisions FOR EACH ROW WHEN (SELECT state FROM episodes WHERE id = NEW.episode_id) = 'final' BEGIN SELECT RAISE(ABORT, 'a final episode is immutable'); END;
CREATE TRIGGER decisions_update_3 BEFORE UPDATE ON decisions FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'decisions are immutable'); END;
CREATE TRIGGER decisions_delete_4 BEFORE DELETE ON decisions FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'decisions are immutable'); END;
CREATE TRIGGER hidden_changes_insert_5 BEFORE INSERT ON hidden_changes FOR EACH ROW WHEN (SELECT state FROM episodes WHERE id = NEW.episode_id) = 'final' BEGIN SELECT RAISE(ABORT, 'a final episode is immutable'); END;
CREATE TRIGGER hidden_changes_update_6 BEFORE UPDATE ON hidden_changes FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'hidden states are immutable'); END;
CREATE TRIGGER hidden_changes_delete_7 BEFORE DELETE ON hidden_changes FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'hidden states are immutable'); END;
CREATE TRIGGER attempts_update_8 BEFORE UPDATE ON attempts FOR EACH ROW WHEN OLD.state <> 'open' BEGIN SELECT RAISE(ABORT, 'an ended attempt is immutable'); END;
CREATE TRIGGER policy_versions_update_9 BEFORE UPDATE ON policy_versions FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'a policy version is immutable'); END;
CREATE TRIGGER policy_versions_delete_10 BEFORE DELETE ON policy_versions FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'a policy version is immutable'); END;
CREATE TRIGGER events_update_11 BEFORE UPDATE ON events FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'events are immutable'); END;
CREATE TRIGGER events_delete_12 BEFORE DELETE ON events FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'events are immutable'); END;
CREATE TRIGGER divergences_update_13 BEFORE UPDATE ON divergences FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'alarms are immutable'); END;
CREATE TRIGGER divergences_delete_14 BEFORE DELETE ON divergences FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'alarms are immutable'); END;
CREATE TRIGGER blobs_update_15 BEFORE UPDATE ON blobs FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'blobs are immutable'); END;
CREATE TRIGGER blobs_delete_16 BEFORE DELETE ON blobs FOR EACH ROW WHEN TRUE BEGIN SELECT RAISE(ABORT, 'blobs are immutable'); END;
CREATE TRIGGER attempts_delete_17 BEFORE DELETE ON attempts FOR EACH ROW WHEN OLD.state <> 'open' BEGIN SELECT RAISE(ABORT, 'an ended attempt is immutable'); END;
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('events',16);
COMMIT;
