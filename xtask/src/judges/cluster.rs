//! Batches under engines for many machines: everything is there once at the end, although a worker is killed in the middle.
//!
//! ```text
//! 200 requests ──engine──▶ parts (lamogen batch --shard) ──one is killed, begins again──▶ lamogen batch --merge
//! ```

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use lamogen_motion::write_atomically;
use serde_json::json;

use super::files::JudgedFiles;
use super::{FOLDER, Result, build_command, install_python, run_command};

/// The number of requests of a batch.
const REQUESTS: usize = 200;
/// The number of finished motions after which a worker is killed.
const BEFORE_THE_KILL: usize = 30;
/// The options of the batches: few steps, since it is not the motions that are checked.
const OPTIONS: [&str; 7] = [
    "--preset",
    "fast",
    "--steps",
    "4",
    "--text-scale=1",
    "--format",
    "npy",
];
/// How long an engine may take.
const TIME_LIMIT: Duration = Duration::from_secs(400);

/// A folder with requests, and the motions that an engine makes of them.
struct Batch {
    folder: PathBuf,
    lamogen: PathBuf,
}

/// A process that is killed when this is dropped.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Batch {
    /// Builds the command and writes the requests, in a folder that is emptied before.
    fn new(name: &str) -> Result<Self> {
        let lamogen = build_command()?;
        let folder = std::path::absolute(Path::new(FOLDER).join(name))?;
        if folder.exists() {
            fs::remove_dir_all(&folder)?;
        }
        fs::create_dir_all(&folder)?;
        let sentences = [
            "a person walks",
            "a person jumps",
            "a person kicks",
            "a person sits down",
        ];
        let lines = (0..REQUESTS).map(|place| {
            let request = json!({
                "id": format!("motion-{place:03}"),
                "prompt": sentences[place % sentences.len()],
                "weight": if place % 2 == 0 { "strong" } else { "light" },
                "seconds": 2,
                "seed": place,
            });
            format!("{request}\n")
        });
        let lines: String = lines.collect();
        let batch = Batch { folder, lamogen };
        write_atomically(&batch.requests(), |file| {
            std::io::Write::write_all(file, lines.as_bytes())
        })?;
        Ok(batch)
    }

    fn requests(&self) -> PathBuf {
        self.folder.join("requests.jsonl")
    }

    fn motions(&self) -> PathBuf {
        self.folder.join("motions")
    }

    /// Returns the names of the files of motions with an ending.
    fn files(&self, ending: &str) -> BTreeSet<String> {
        let entries = fs::read_dir(self.motions()).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        names
            .filter(|name| !name.starts_with('.') && name.ends_with(ending))
            .collect()
    }

    /// Waits until some motions are finished, and kills one of the workers.
    fn kill_one_worker(&self) -> Result<()> {
        let start = Instant::now();
        while self.files(".json").len() < BEFORE_THE_KILL {
            if start.elapsed() > TIME_LIMIT {
                return Err("expected motions, found too few within the time limit".into());
            }
            sleep(Duration::from_millis(50));
        }
        let worker = self.workers()?.into_iter().next();
        let worker =
            worker.ok_or("expected a worker to kill, found none: the batch is too small")?;
        println!(
            "killing process {worker} after {} motions",
            self.files(".json").len()
        );
        run_command(Command::new("kill").args(["-KILL", &worker.to_string()]))
    }

    /// Returns the processes that work on this batch.
    fn workers(&self) -> Result<Vec<u32>> {
        let motions = self.motions();
        let mut workers = Vec::new();
        for entry in fs::read_dir("/proc")?.flatten() {
            let Some(process) = entry
                .file_name()
                .to_str()
                .and_then(|name| name.parse().ok())
            else {
                continue;
            };
            let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let mut words = line.split(|byte| *byte == 0);
            let is_lamogen = words.next().is_some_and(|word| word.ends_with(b"lamogen"));
            let is_ours = words.any(|word| word == motions.as_os_str().as_encoded_bytes());
            if is_lamogen && is_ours {
                workers.push(process);
            }
        }
        Ok(workers)
    }

    /// Checks that every motion is there once, by the command and by the files.
    fn check(&self) -> Result<()> {
        let mut merge = Command::new(&self.lamogen);
        merge
            .arg("batch")
            .arg(self.requests())
            .arg("--out")
            .arg(self.motions());
        run_command(merge.args(OPTIONS).arg("--merge"))?;
        for ending in [".json", ".npy"] {
            let found = self.files(ending).len();
            if found != REQUESTS {
                return Err(format!("expected {REQUESTS} files *{ending}, found {found}").into());
            }
        }
        Ok(())
    }
}

/// The folder of the scripts for users.
fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cluster")
}

/// Runs a batch by HyperQueue's Python package on a worker of this machine.
pub(super) fn check_under_hyperqueue(_: &Path, _: &JudgedFiles) -> Result<()> {
    let batch = Batch::new("hyperqueue")?;
    let python = install_python("hyperqueue-venv", "hyperqueue")?.join("python");
    let mut engine = Command::new(python);
    engine.arg(examples().join("hyperqueue_batch.py"));
    engine.arg(batch.requests()).arg(batch.motions());
    engine
        .args(["--shards", "8", "--lamogen"])
        .arg(&batch.lamogen);
    engine.arg("--").args(OPTIONS);
    let log = fs::File::create(batch.folder.join("hyperqueue.log"))?;
    engine.stdout(log.try_clone()?).stderr(log);
    let mut engine = Killed(engine.spawn()?);
    batch.kill_one_worker()?;
    let start = Instant::now();
    let status = loop {
        match engine.0.try_wait()? {
            Some(status) => break status,
            None if start.elapsed() > TIME_LIMIT => return Err("it did not end in time".into()),
            None => sleep(Duration::from_millis(100)),
        }
    };
    let log = fs::read_to_string(batch.folder.join("hyperqueue.log"))?;
    if !status.success() || !log.contains("attempt 1: 1 of 8 shards failed") {
        return Err(format!(
            "expected one shard to fail and to be made again, found {status}: {log}"
        )
        .into());
    }
    batch.check()
}

/// Daemons of Slurm and of its authentication, which end when this is dropped.
struct Slurm {
    folder: tempfile::TempDir,
    daemons: Vec<Killed>,
}

impl Slurm {
    /// Starts a cluster of one node, this machine, with all of its files in a temporary folder.
    fn start() -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let place = |name: &str| folder.path().join(name).display().to_string();
        let host = Command::new("hostname").arg("-s").output()?.stdout;
        let host = String::from_utf8(host)?.trim().to_owned();
        let config = format!(
            "ClusterName=judges\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nSlurmdUser=root\n\
             AuthType=auth/munge\nAuthInfo=socket={socket}\nCryptoType=crypto/munge\n\
             StateSaveLocation={state}\nSlurmdSpoolDir={spool}\n\
             SlurmctldPidFile={controller}.pid\nSlurmdPidFile={node}.pid\n\
             SlurmctldLogFile={controller}.log\nSlurmdLogFile={node}.log\n\
             SlurmctldPort=26817\nSlurmdPort=26818\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nMpiDefault=none\n\
             JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nReturnToService=2\n\
             NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=1000 State=UNKNOWN\n\
             PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n",
            socket = place("munge.socket"),
            state = place("state"),
            spool = place("spool"),
            controller = place("slurmctld"),
            node = place("slurmd"),
        );
        for name in ["state", "spool"] {
            fs::create_dir(folder.path().join(name))?;
        }
        fs::write(folder.path().join("slurm.conf"), config)?;
        // Munge wants a key that nobody else reads, and a socket that everybody reaches.
        use std::os::unix::fs::PermissionsExt;
        let key = folder.path().join("munge.key");
        let mut random = vec![0; 1024];
        std::io::Read::read_exact(&mut fs::File::open("/dev/urandom")?, &mut random)?;
        fs::write(&key, random)?;
        fs::set_permissions(&key, fs::Permissions::from_mode(0o600))?;
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755))?;

        let mut slurm = Slurm {
            folder,
            daemons: Vec::new(),
        };
        let mut munge = slurm.command("munged");
        munge.args(["--foreground", "--force"]);
        for (option, name) in [
            ("key-file", "munge.key"),
            ("socket", "munge.socket"),
            ("pid-file", "munge.pid"),
            ("seed-file", "munge.seed"),
        ] {
            munge.arg(format!(
                "--{option}={}",
                slurm.folder.path().join(name).display()
            ));
        }
        for mut daemon in [munge, slurm.command("slurmctld"), slurm.command("slurmd")] {
            if !slurm.daemons.is_empty() {
                daemon.arg("-D");
            }
            daemon.stdout(Stdio::null()).stderr(Stdio::null());
            slurm.daemons.push(Killed(daemon.spawn()?));
            sleep(Duration::from_secs(2));
        }
        Ok(slurm)
    }

    /// Returns a command that finds this cluster.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.folder.path().join("slurm.conf"));
        command
    }

    /// Returns what a command prints.
    fn output(&self, program: &str, arguments: &[&str]) -> Result<String> {
        let output = self.command(program).args(arguments).output()?;
        match output.status.success() {
            true => Ok(String::from_utf8(output.stdout)?),
            false => Err(format!("{program}: {}", String::from_utf8_lossy(&output.stderr)).into()),
        }
    }
}

/// Runs a batch as a job array of Slurm, on one node.
pub(super) fn check_under_slurm(_: &Path, _: &JudgedFiles) -> Result<()> {
    if !Command::new("id")
        .arg("-u")
        .output()?
        .stdout
        .starts_with(b"0")
    {
        println!("left out: Slurm's daemons have to be started by root");
        return Ok(());
    }
    let batch = Batch::new("slurm")?;
    let slurm = Slurm::start()?;
    let mut submission = slurm.command("sbatch");
    submission.args(["--array=1-8", "--cpus-per-task=1", "--mem=200M"]);
    submission.arg(format!(
        "--output={}",
        batch.folder.join("slurm-%a.log").display()
    ));
    submission.arg(examples().join("slurm.sh"));
    submission
        .arg(batch.requests())
        .arg(batch.motions())
        .args(OPTIONS);
    run_command(submission.env("LAMOGEN", &batch.lamogen))?;
    batch.kill_one_worker()?;
    let start = Instant::now();
    loop {
        let jobs = slurm.output("squeue", &["-h", "-o", "%i %r"])?;
        if jobs.trim().is_empty() {
            break;
        }
        if start.elapsed() > TIME_LIMIT {
            return Err(format!("it did not end in time: {jobs}").into());
        }
        // A task that was put back waits two minutes; nobody here does.
        for line in jobs.lines().filter(|line| line.ends_with("BeginTime")) {
            let job = line.split(' ').next().unwrap_or_default();
            let job = format!("JobId={job}");
            let _ = slurm.output("scontrol", &["update", &job, "StartTime=now"]);
        }
        sleep(Duration::from_millis(500));
    }
    let logs = (1..=8).map(|task| batch.folder.join(format!("slurm-{task}.log")));
    let logs: String = logs
        .filter_map(|log| fs::read_to_string(log).ok())
        .collect();
    if !logs.contains("the task goes back into the queue") {
        return Err(format!("expected a task to go back into the queue, found: {logs}").into());
    }
    batch.check()
}
