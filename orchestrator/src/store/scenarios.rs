//! Recipes and scenarios.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError, hex_list, signed, to_json, unsigned};

/// Stores recipes, once each.
///
/// # Errors
/// The database's.
pub async fn insert_recipes(conn: &mut SqliteConnection, recipes: &[&Recipe]) -> Result<(), StoreError> {
    let rows = recipes.iter().map(|recipe| Ok((recipe.id().0, to_json(&recipe.to_json())?)));
    // Scenarios that come together are often of few recipes.
    let rows = rows.collect::<Result<BTreeMap<_, _>, StoreError>>()?;
    for rows in rows.iter().collect::<Vec<_>>().chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO recipes (id, body) ");
        statement.push_values(rows, |mut values, (id, body)| {
            values.push_bind(id.as_slice()).push_bind(body);
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Stores scenarios and their recipes, once each.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, scenarios: &[&Scenario]) -> Result<(), StoreError> {
    let recipes: Vec<&Recipe> = scenarios.iter().map(|scenario| &**scenario.recipe()).collect();
    insert_recipes(conn, &recipes).await?;
    for rows in scenarios.chunks(ROWS) {
        let mut statement = QueryBuilder::new("INSERT INTO scenarios (id, recipe, seed) ");
        statement.push_values(rows, |mut values, scenario| {
            values.push_bind(scenario.id().0.to_vec()).push_bind(scenario.recipe().id().0.to_vec());
            values.push_bind(signed(scenario.seed().get()));
        });
        statement.push(" ON CONFLICT (id) DO NOTHING").build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// The seed of a scenario.
///
/// # Errors
/// The database's.
pub async fn seed(conn: &mut SqliteConnection, id: &[u8]) -> Result<Option<u64>, StoreError> {
    let seed =
        sqlx::query_scalar!("SELECT seed FROM scenarios WHERE id = ?", id).fetch_optional(conn).await?;
    Ok(seed.map(unsigned))
}

/// Reads scenarios, each recipe once.
#[derive(Debug, Default)]
pub struct Loader {
    recipes: HashMap<Vec<u8>, Arc<Recipe>>,
}

/// Scenarios that were read together. One that cannot be brought back holds up no other.
#[derive(Debug, Default)]
pub struct Scenarios(HashMap<Vec<u8>, Result<Scenario, StoreError>>);

impl Scenarios {
    /// A scenario by its id.
    ///
    /// # Errors
    /// One that is not there, or cannot be read.
    pub fn get(&self, id: &[u8]) -> Result<&Scenario, StoreError> {
        match self.0.get(id) {
            Some(Ok(scenario)) => Ok(scenario),
            Some(Err(error)) => Err(StoreError::unreadable("a scenario", error)),
            None => Err(gone("a scenario")),
        }
    }
}

fn gone(what: &'static str) -> StoreError {
    StoreError::unreadable(what, "it is gone")
}

impl Loader {
    /// A scenario by its id.
    ///
    /// # Errors
    /// The database's, or a scenario that cannot be read.
    pub async fn get(&mut self, conn: &mut SqliteConnection, id: &[u8]) -> Result<Scenario, StoreError> {
        self.all(conn, &[id]).await?.get(id).cloned()
    }

    /// Scenarios by their ids, in one statement however many they are.
    ///
    /// # Errors
    /// The database's.
    pub async fn all<T: AsRef<[u8]>>(
        &mut self,
        conn: &mut SqliteConnection,
        ids: &[T],
    ) -> Result<Scenarios, StoreError> {
        let ids = hex_list(ids)?;
        let rows = query!(
            r#"SELECT id AS "id!: Vec<u8>", seed AS "seed?: i64", recipe AS "recipe?: Vec<u8>", NULL AS "body?: String"
               FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?1))
               UNION ALL
               SELECT id, NULL, NULL, body FROM recipes WHERE id IN (
                   SELECT recipe FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?1)))"#,
            ids
        )
        .fetch_all(&mut *conn)
        .await?;
        let (mut scenarios, mut bodies) = (Vec::new(), HashMap::new());
        for row in rows {
            match (row.seed, row.recipe, row.body) {
                (Some(seed), Some(recipe), _) => scenarios.push((row.id, seed, recipe)),
                (.., Some(body)) => drop(bodies.insert(row.id, body)),
                _ => {}
            }
        }
        let read = scenarios.into_iter().map(|(id, seed, recipe)| {
            let recipe = self.parsed(&recipe, bodies.get(&recipe));
            (id, recipe.and_then(|recipe| Ok(Scenario::new(recipe, Seed::new(unsigned(seed))?))))
        });
        Ok(Scenarios(read.collect()))
    }

    /// A recipe by its id.
    ///
    /// # Errors
    /// The database's, or a recipe that cannot be read.
    pub async fn recipe(
        &mut self,
        conn: &mut SqliteConnection,
        id: &[u8],
    ) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body =
            sqlx::query_scalar!("SELECT body FROM recipes WHERE id = ?", id).fetch_optional(conn).await?;
        self.parsed(id, body.as_ref())
    }

    /// A recipe that is known, or read from its body.
    fn parsed(&mut self, id: &[u8], body: Option<&String>) -> Result<Arc<Recipe>, StoreError> {
        if let Some(recipe) = self.recipes.get(id) {
            return Ok(Arc::clone(recipe));
        }
        let body = body.ok_or_else(|| gone("a recipe"))?;
        let value: serde_json::Value = super::from_json("a recipe", body)?;
        let recipe = Arc::new(Recipe::from_json(&value)?);
        self.recipes.insert(id.to_owned(), Arc::clone(&recipe));
        Ok(recipe)
    }
}
