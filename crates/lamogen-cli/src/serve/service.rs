//! The work behind the server: lamogen's model and readers.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use lamogen::files::read_bytes;
use lamogen::{Component, Error, FRAMES_PER_SECOND, Generation, Joint, Pass, Request, Tag};
use lamogen_server::{
    MotionService, Problem, ProblemKind, ProcessorShare, UploadedFile, WorkError, WorkObserver,
    WorkProgress,
};
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::{Value, json};

use super::characters::{CharacterStore, StoredCharacter};
use super::file_name;
use super::format::{MEDIA_TYPES, format_of};
use super::problem::{failure_problem, request_problem, run_problem};
use super::request::ServedRequest;
use crate::arguments::{MotionReadingArguments, StreamFormat, WritingArguments};
use crate::console::Console;
use crate::generate::generation_facts;
use crate::motion_file::read_options;
use crate::output::{OutputFile, OutputFormat};
use crate::report::{component_key, measurement_json, scene_json};
use crate::scene::Scene;
use crate::source::ModelSource;

/// The number of motions of texts alone that are kept, for sliders: while one drags, a coarse and a full one are in use.
const KEPT_BASELINES: usize = 16;

/// The model of the command as a service.
pub struct CommandService {
    source: ModelSource,
    console: Console,
    /// The length of the longest motion in seconds.
    max_seconds: f32,
    /// Threads of works that run beside others, while no work uses them.
    idle_pools: Mutex<Vec<ThreadPool>>,
    characters: CharacterStore,
}

impl CommandService {
    /// Makes a service of a model, for motions of at most so many seconds.
    pub fn new(mut source: ModelSource, console: Console, max_seconds: u32) -> CommandService {
        source.model = source.model.with_kept_baselines(KEPT_BASELINES);
        CommandService {
            source,
            console,
            max_seconds: max_seconds as f32,
            idle_pools: Mutex::default(),
            characters: CharacterStore::new(),
        }
    }

    /// Runs a work on its share of the processors. Motions do not depend on the number of threads.
    fn run_on<T: Send>(
        &self,
        share: ProcessorShare,
        work: impl FnOnce() -> Result<T, WorkError> + Send,
    ) -> Result<T, WorkError> {
        if share.is_all() {
            return work();
        }
        let pools = || {
            self.idle_pools
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        };
        let idle = pools().pop();
        let pool = match idle {
            Some(pool) => pool,
            None => {
                let threads = share.of(rayon::current_num_threads());
                let pool = ThreadPoolBuilder::new().num_threads(threads).build();
                pool.map_err(|error| Problem::new(ProblemKind::Internal, error))?
            }
        };
        let result = pool.install(work);
        pools().push(pool);
        result
    }

    /// Generates a short motion, so that the first request does not wait for threads to start and memory to be mapped.
    pub fn warm_up(&self) {
        let shortest = *self.source.model.lengths().start();
        let request = Request::new("a person walks").frames(shortest).steps(1);
        // A model that cannot do this says so to the first request.
        let _ = self.source.model.generate(&request);
    }

    /// Makes a request of the model, and checks it.
    fn request(&self, served: &ServedRequest) -> Result<Request, Problem> {
        let model = &self.source.model;
        let request = served.request(model.preset(), &self.source.device())?;
        model
            .check(&request)
            .map_err(|error| request_problem(&error))?;
        Ok(request)
    }

    /// Writes the file of a motion in a media type, on a character if there is one.
    fn write(
        &self,
        served: &ServedRequest,
        generation: Generation,
        character: Option<&StoredCharacter>,
        media_type: &str,
    ) -> Result<Vec<u8>, WorkError> {
        let pass = served.pass();
        let facts = generation_facts(served.seed(), &generation, &pass, &self.source);
        let scene = Scene::from_generation(generation, facts);
        let format = format_of(media_type);
        match (character, format) {
            (Some(character), OutputFormat::Glb) => return Ok(character.file(&scene)?),
            (Some(character), OutputFormat::Json) => {
                return Ok(character.json(&scene)?.to_string().into_bytes());
            }
            _ => {}
        }
        let file = OutputFile {
            path: PathBuf::from("motion").with_extension(format.ending()),
            format,
        };
        file.content(&scene, &WritingArguments::default(), &self.console)
            .map_err(|failure| failure_problem(ProblemKind::GenerationFailed, &failure).into())
    }
}

impl MotionService for CommandService {
    type Request = ServedRequest;

    fn media_types(&self) -> &'static [&'static str] {
        &MEDIA_TYPES
    }

    fn model(&self) -> Value {
        let model = &self.source.model;
        let lengths = model.lengths();
        let licence = model.licence().map(ToString::to_string);
        let components = Component::ALL.map(|component| {
            let tags = Tag::ALL
                .into_iter()
                .filter(|tag| tag.component() == component);
            let words = tags.map(|tag| json!({ "word": tag.to_string(), "factor": tag.scale() }));
            json!({
                "name": component.to_string(),
                "key": component_key(component),
                "unit": component.unit(),
                "words": words.collect::<Vec<Value>>(),
            })
        });
        json!({
            "generator": concat!("lamogen ", env!("CARGO_PKG_VERSION")),
            "model": self.source.name,
            "licence": licence,
            "frames": [lengths.start(), lengths.end()],
            "max_seconds": self.max_seconds,
            "frames_per_second": FRAMES_PER_SECOND,
            "preset": model.preset().name(),
            "steps": model.default_steps(model.preset()),
            "joints": Joint::ALL.map(Joint::name),
            "components": components,
            "formats": MEDIA_TYPES,
        })
    }

    fn parse(&self, json: &str) -> Result<ServedRequest, Problem> {
        let served = ServedRequest::parse(json)?;
        served.check_length(self.max_seconds)?;
        self.request(&served)?;
        if let Some(onto) = &served.onto {
            self.characters.find(onto)?;
        }
        Ok(served)
    }

    fn generate(
        &self,
        served: &ServedRequest,
        media_type: &str,
        share: ProcessorShare,
        observer: WorkObserver<'_>,
    ) -> Result<Vec<u8>, WorkError> {
        let request = self.request(served)?;
        let character = served
            .onto
            .as_deref()
            .map(|onto| self.characters.find(onto));
        let character = character.transpose()?;
        // A client may have gone while its request waited.
        if observer(WorkProgress::default()).is_break() {
            return Err(WorkError::Stopped);
        }
        self.run_on(share, || {
            let generation = self.source.model.generate_with(&request, &mut |progress| {
                observer(WorkProgress {
                    done: progress.done,
                    total: progress.total,
                    stage: stage_name(progress.step.pass),
                })
            });
            let generation = generation.map_err(|error| match &error {
                Error::Stopped(_) => WorkError::Stopped,
                _ => WorkError::Failed(run_problem(&error)),
            })?;
            self.write(served, generation, character.as_deref(), media_type)
        })
    }

    fn measure(&self, file: &UploadedFile) -> Result<Value, Problem> {
        let FileOptions {
            name,
            has_joints,
            reading,
        } = FileOptions::parse(file)?;
        let unreadable = |reason: &dyn std::fmt::Display| {
            Problem::new(ProblemKind::UnreadableFile, reason).at(&name)
        };
        let options = read_options(&reading)
            .map_err(|failure| failure_problem(ProblemKind::InvalidRequest, &failure))?;
        let imported =
            read_bytes(&file.bytes, &name, &options).map_err(|error| unreadable(&error))?;
        let notices: Vec<String> = imported.notices.iter().map(ToString::to_string).collect();
        let mut scene = Scene::from_file(Path::new(&name), imported, &self.source.device());
        scene.facts.insert("notices".into(), notices.into());
        Ok(match has_joints {
            true => scene_json(&scene),
            false => measurement_json(&scene).into(),
        })
    }

    fn add_character(&self, file: &UploadedFile) -> Result<Value, Problem> {
        self.characters.add(file)
    }
}

/// Returns the name of a part of a run.
fn stage_name(pass: Pass) -> &'static str {
    match pass {
        Pass::Baseline => "baseline",
        Pass::Guided => "guided",
        Pass::Body => "body",
    }
}

/// The options of an uploaded file.
struct FileOptions {
    /// The name without any folders.
    name: String,
    /// Whether the report has the positions of the joints.
    has_joints: bool,
    reading: MotionReadingArguments,
}

impl FileOptions {
    /// Parses the options of an address.
    fn parse(file: &UploadedFile) -> Result<FileOptions, Problem> {
        let invalid = |name: &str, reason: &dyn std::fmt::Display| {
            Problem::new(ProblemKind::InvalidRequest, reason).at(name)
        };
        let mut options = FileOptions {
            name: String::new(),
            has_joints: false,
            reading: MotionReadingArguments::default(),
        };
        for (key, value) in &file.options {
            let wrong = |reason: &dyn std::fmt::Display| invalid(key, reason);
            let reading = &mut options.reading;
            match key.as_str() {
                "name" => {
                    options.name = file_name(value).to_owned();
                }
                "joints" => {
                    options.has_joints = value.parse().map_err(|_| {
                        let problem =
                            Problem::mismatch(ProblemKind::InvalidRequest, "true or false", value);
                        problem.at(key)
                    })?;
                }
                "unit" => reading.unit = Some(value.parse().map_err(|error| wrong(&error))?),
                "up" => reading.up = Some(value.parse().map_err(|error| wrong(&error))?),
                "fps" => {
                    reading.input_fps = Some(value.parse().map_err(|_| {
                        let problem =
                            Problem::mismatch(ProblemKind::InvalidRequest, "a number", value);
                        problem.at(key)
                    })?);
                }
                "animation" => reading.animation = Some(value.clone()),
                _ => {
                    let expected = "one of name, joints, unit, up, fps, animation";
                    let problem = Problem::mismatch(ProblemKind::InvalidRequest, expected, key);
                    return Err(problem.at("query"));
                }
            }
        }
        if options.name.is_empty() {
            let format = StreamFormat::detect(&file.bytes).ok_or_else(|| {
                let expected = "a motion in BVH, GLB, glTF or NumPy's format";
                Problem::mismatch(ProblemKind::UnreadableFile, expected, "none of these").at("body")
            })?;
            options.name = format!("motion.{}", format.ending());
        }
        Ok(options)
    }
}
