//! Buckets of JetStream's object store: payloads that are too large for a message.

use std::borrow::Cow;
use std::time::Duration;

use async_nats::header::HeaderValue;
use async_nats::jetstream::Context;
use async_nats::jetstream::context::GetStreamErrorKind;
use async_nats::jetstream::object_store::{Config, GetErrorKind, InfoErrorKind, ObjectStore};
use async_nats::jetstream::stream::Stream;
use async_nats::{HeaderMap, Message};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE;
use jobs::envelope::MAX_MESSAGE_BYTES;
use tokio::io::AsyncReadExt;

use super::connection::NatsError;

/// Header of a message whose payload is an object: the name of the object in the bucket.
pub(crate) const OBJECT_HEADER: &str = "Sparring-Object";
/// Header of such a message: the BLAKE3 digest of the payload, so that no other client can replace the object.
const DIGEST_HEADER: &str = "Sparring-Digest";

/// Returns the name of the object that has the payload of a message; `None` if the message has its payload itself.
pub(crate) fn object_of(message: &Message) -> Option<&str> {
    message.headers.as_ref()?.get(OBJECT_HEADER).map(HeaderValue::as_str)
}

/// A bucket, which is created with its first object.
#[derive(Clone)]
pub(crate) struct ObjectBucket {
    context: Context,
    name: String,
    /// Age after which objects are deleted; zero keeps them.
    max_age: Duration,
}

impl ObjectBucket {
    /// Names a bucket; nothing is created.
    pub(crate) const fn new(context: Context, name: String, max_age: Duration) -> Self {
        Self { context, name, max_age }
    }

    /// Returns the payload of a message with these headers: `bytes`, or nothing if they are stored as an object that the headers name.
    pub(crate) async fn wrap(
        &self,
        object: &str,
        bytes: Vec<u8>,
        headers: &mut HeaderMap,
    ) -> Result<Vec<u8>, NatsError> {
        if bytes.len() <= MAX_MESSAGE_BYTES {
            return Ok(bytes);
        }
        self.put(object, &bytes).await?;
        headers.insert(OBJECT_HEADER, object);
        headers.insert(DIGEST_HEADER, blake3::hash(&bytes).to_hex().as_str());
        Ok(Vec::new())
    }

    /// Returns the payload of a message, of at most `max_bytes`; `None` if its object is gone or was replaced.
    pub(crate) async fn payload<'m>(
        &self,
        message: &'m Message,
        max_bytes: usize,
    ) -> Result<Option<Cow<'m, [u8]>>, NatsError> {
        let Some(object) = object_of(message) else { return Ok(Some(Cow::Borrowed(&message.payload))) };
        let digest = message.headers.as_ref().and_then(|headers| headers.get(DIGEST_HEADER));
        let bytes = self.get(object, max_bytes).await?;
        let is_same = |bytes: &Vec<u8>| {
            digest.is_some_and(|digest| digest.as_str() == blake3::hash(bytes).to_hex().as_str())
        };
        Ok(bytes.filter(is_same).map(Cow::Owned))
    }

    /// Creates the bucket if it does not exist.
    pub(crate) async fn ensure(&self) -> Result<(), NatsError> {
        if self.find().await?.is_none() {
            self.create().await?;
        }
        Ok(())
    }

    /// Stores an object, in place of an earlier one of the same name.
    async fn put(&self, object: &str, bytes: &[u8]) -> Result<(), NatsError> {
        let failed = |error: &dyn std::fmt::Display| NatsError::new("an object cannot be stored", error);
        let bucket = match self.find().await? {
            Some(bucket) => bucket,
            None => self.create().await?,
        };
        let mut reader = bytes;
        bucket.put(object, &mut reader).await.map_err(|error| failed(&error))?;
        Ok(())
    }

    /// Reads an object of at most `max_bytes`; `None` if there is none.
    async fn get(&self, object: &str, max_bytes: usize) -> Result<Option<Vec<u8>>, NatsError> {
        let failed = |error: &dyn std::fmt::Display| NatsError::new("an object cannot be read", error);
        let Some(bucket) = self.find().await? else { return Ok(None) };
        let found = match bucket.get(object).await {
            Ok(found) => found,
            Err(error) if error.kind() == GetErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(failed(&error)),
        };
        if found.info().size > max_bytes {
            return Err(failed(&format!("it has {} bytes, more than {max_bytes}", found.info().size)));
        }
        let mut bytes = Vec::with_capacity(found.info().size);
        let limit = u64::try_from(max_bytes).unwrap_or(u64::MAX);
        found.take(limit).read_to_end(&mut bytes).await.map_err(|error| failed(&error))?;
        Ok(Some(bytes))
    }

    /// Deletes an object with every trace of it, if it exists.
    pub(crate) async fn delete(&self, object: &str) -> Result<(), NatsError> {
        let failed = |error: &dyn std::fmt::Display| NatsError::new("an object cannot be deleted", error);
        let Some(bucket) = self.find().await? else { return Ok(()) };
        let nuid = match bucket.info(object).await {
            Ok(info) => info.nuid,
            Err(error) if error.kind() == InfoErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(failed(&error)),
        };
        let Some(stream) = self.stream().await? else { return Ok(()) };
        // `ObjectStore::delete` would leave a message for each object.
        let name = URL_SAFE.encode(object);
        for subject in [format!("$O.{}.C.{nuid}", self.name), format!("$O.{}.M.{name}", self.name)] {
            stream.purge().filter(subject).await.map_err(|error| failed(&error))?;
        }
        Ok(())
    }

    /// Deletes the bucket with all objects, if it exists.
    pub(crate) async fn remove(&self) -> Result<(), NatsError> {
        if self.stream().await?.is_none() {
            return Ok(());
        }
        let deleted = self.context.delete_object_store(&self.name).await;
        deleted.map_err(|error| NatsError::new("a bucket of objects cannot be deleted", error))
    }

    async fn create(&self) -> Result<ObjectStore, NatsError> {
        let config = Config {
            bucket: self.name.clone(),
            description: Some("Sparring: payloads above 512 KiB".to_owned()),
            max_age: self.max_age,
            compression: true,
            ..Config::default()
        };
        let created = self.context.create_object_store(config).await;
        created.map_err(|error| NatsError::new("a bucket of objects cannot be created", error))
    }

    async fn find(&self) -> Result<Option<ObjectStore>, NatsError> {
        if self.stream().await?.is_none() {
            return Ok(None);
        }
        let found = self.context.get_object_store(&self.name).await;
        found.map(Some).map_err(|error| NatsError::new("a bucket of objects cannot be opened", error))
    }

    async fn stream(&self) -> Result<Option<Stream>, NatsError> {
        find_stream(&self.context, &format!("OBJ_{}", self.name)).await
    }
}

/// Returns a stream with its current state; `None` if it does not exist.
pub(crate) async fn find_stream(context: &Context, name: &str) -> Result<Option<Stream>, NatsError> {
    match context.get_stream(name).await {
        Ok(stream) => Ok(Some(stream)),
        Err(error) => match error.kind() {
            GetStreamErrorKind::JetStream(error) if error.code() == 404 => Ok(None),
            _ => Err(NatsError::new(&format!("the stream {name} cannot be read"), error)),
        },
    }
}

/// Deletes an object of a job when it is dropped.
pub(crate) struct ObjectGuard {
    objects: ObjectBucket,
    name: String,
}

impl ObjectGuard {
    /// Deletes the object of this name later.
    pub(crate) fn new(objects: &ObjectBucket, name: String) -> Self {
        Self { objects: objects.clone(), name }
    }
}

impl Drop for ObjectGuard {
    fn drop(&mut self) {
        let (objects, name) = (self.objects.clone(), std::mem::take(&mut self.name));
        // A bucket deletes old objects itself, if NATS is away now.
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            drop(runtime.spawn(async move { objects.delete(&name).await }));
        }
    }
}
